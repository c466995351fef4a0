//! The server's side of the page: files, the WebSocket, the picture as a PNG.

use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Router, middleware};
use tokio::sync::watch;

use crate::palette::Palette;
use crate::png;
use crate::web::{Command, FAREWELL, Published, Shared, guard};
use crate::wire::{Clock, Request, Scene};

/// Pictures a page may have been sent without having taken them.
const CREDITS: usize = 2;

/// The longest message taken from a page, bytes.
const LONGEST_REQUEST: usize = 1024;

/// Path, media type and text of the page's files.
const FILES: [(&str, &str, &str); 8] = [
    ("/", "text/html; charset=utf-8", include_str!("../page/index.html")),
    (
        "/style.css",
        "text/css; charset=utf-8",
        include_str!("../page/style.css"),
    ),
    ("/main.js", JS, include_str!("../page/main.js")),
    ("/wire.js", JS, include_str!("../page/wire.js")),
    ("/field.js", JS, include_str!("../page/field.js")),
    ("/sheet.js", JS, include_str!("../page/sheet.js")),
    ("/labels.js", JS, include_str!("../page/labels.js")),
    ("/trace.js", JS, include_str!("../page/trace.js")),
];
const JS: &str = "text/javascript; charset=utf-8";

/// Nothing from elsewhere, and no place in another page's frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

#[derive(Clone)]
struct App {
    shared: Arc<Shared>,
    stopped: watch::Receiver<bool>,
}

/// Serves until `stopped` turns true, and a little longer for the farewell.
pub(super) async fn serve(
    listener: TcpListener,
    shared: Arc<Shared>,
    stopped: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let files = FILES.into_iter().fold(Router::new(), |router, (path, media, text)| {
        router.route(path, get(move || async move { file(media, text.into()) }))
    });
    let app = files
        .route("/palettes.js", get(|| async { file(JS, palettes()) }))
        .route("/picture.png", get(picture))
        .route("/live", get(live))
        .layer(middleware::from_fn(guard::check))
        .with_state(App {
            shared: Arc::clone(&shared),
            stopped: stopped.clone(),
        });
    let graceful = ended(stopped.clone());
    let deadline = async {
        ended(stopped).await;
        tokio::time::sleep(FAREWELL).await;
    };
    let serving = async {
        axum::serve(listener, app).with_graceful_shutdown(graceful).await?;
        // Its connections have become WebSockets, which are on their own: let them say good-bye.
        while shared.clients.load(Ordering::Relaxed) > 0 {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
        Ok(())
    };
    tokio::select! {
        result = serving => result,
        () = deadline => Ok(()),
    }
}

/// Returns once the server is to stop.
async fn ended(mut stopped: watch::Receiver<bool>) {
    // An error means that the sender is gone, which is an end as well.
    let _ = stopped.wait_for(|stop| *stop).await;
}

fn file(media: &'static str, text: String) -> Response {
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(media)),
        // A newer program must not be shown through an older page.
        (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
        (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
        (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
    ];
    (headers, text).into_response()
}

/// The colour maps as a script: six hexadecimal digits per colour.
fn palettes() -> String {
    let sequential = [Palette::Inferno, Palette::Viridis, Palette::Grey];
    let line = |palette: Palette| {
        let digits: String = palette
            .table()
            .as_flattened()
            .iter()
            .map(|v| format!("{v:02x}"))
            .collect();
        format!("  {}: \"{digits}\",\n", palette.name())
    };
    format!("export const palettes = {{\n{}}};\n", sequential.map(line).concat())
}

/// The newest picture as a PNG.
async fn picture(State(app): State<App>) -> Response {
    let Some(latest) = app.shared.latest.borrow().as_ref().map(|l| Arc::clone(&l.picture)) else {
        return (StatusCode::NOT_FOUND, "no picture yet\n").into_response();
    };
    let draw = move || {
        let mut bytes = Vec::new();
        png::render(&latest, 1200)?.encode_png(&mut bytes)?;
        Ok::<_, crate::canvas::ImageError>(bytes)
    };
    match tokio::task::spawn_blocking(draw).await {
        Ok(Ok(bytes)) => (
            [(header::CONTENT_TYPE, "image/png"), (header::CACHE_CONTROL, "no-store")],
            bytes,
        )
            .into_response(),
        Ok(Err(error)) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
        Err(_) => (StatusCode::INTERNAL_SERVER_ERROR, "the picture could not be drawn\n").into_response(),
    }
}

async fn live(upgrade: WebSocketUpgrade, State(app): State<App>) -> Response {
    upgrade
        .max_message_size(LONGEST_REQUEST)
        .max_frame_size(LONGEST_REQUEST)
        .on_upgrade(move |socket| async move {
            let _present = Present::new(&app.shared);
            if let Err(error) = attend(socket, &app.shared, app.stopped).await {
                tracing::debug!("a page has gone: {error}");
            }
        })
}

/// Counts a connected page as long as it lives.
struct Present<'a>(&'a Shared);

impl<'a> Present<'a> {
    fn new(shared: &'a Shared) -> Self {
        shared.clients.fetch_add(1, Ordering::Relaxed);
        Self(shared)
    }
}

impl Drop for Present<'_> {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Serves one page until it leaves or the server stops.
async fn attend(mut socket: WebSocket, shared: &Shared, stopped: watch::Receiver<bool>) -> Result<(), axum::Error> {
    let mut stop = std::pin::pin!(ended(stopped));
    let mut latest = shared.latest.subscribe();
    // The picture that is there already is news to this page.
    latest.mark_changed();
    let (mut credits, mut scene, mut number) = (CREDITS, 0, 0);
    loop {
        tokio::select! {
            biased;
            () = &mut stop => return socket.send(Message::Close(None)).await,
            message = socket.recv() => match message.transpose()? {
                None | Some(Message::Close(_)) => return Ok(()),
                Some(Message::Binary(_)) => credits = (credits + 1).min(CREDITS),
                Some(Message::Text(text)) => answer(&mut socket, shared, &text).await?,
                Some(_) => {}
            },
            changed = latest.changed(), if credits > 0 => {
                if changed.is_err() {
                    return Ok(());
                }
                let Some((text, frame)) = news(&mut latest, shared, &mut scene, &mut number) else {
                    continue;
                };
                if let Some(text) = text {
                    socket.send(Message::Text(text.into())).await?;
                }
                socket.send(Message::Binary(frame)).await?;
                credits -= 1;
            }
        }
    }
}

/// What to send to a page that has seen picture `number` of `scene`: the scene if it is another, and the frame.
fn news(
    latest: &mut watch::Receiver<Option<Published>>,
    shared: &Shared,
    scene: &mut u32,
    number: &mut u64,
) -> Option<(Option<String>, Bytes)> {
    let newest = latest.borrow_and_update();
    let published = newest.as_ref()?;
    let text = (*scene != published.scene).then(|| {
        (*scene, *number) = (published.scene, 0);
        scene_text(published, shared)
    });
    let frame = published.frame(*number, &shared.encoded);
    *number = published.shown.number();
    Some((text, frame))
}

async fn answer(socket: &mut WebSocket, shared: &Shared, text: &str) -> Result<(), axum::Error> {
    match serde_json::from_str(text) {
        Ok(Request::Tare) => {
            command(shared, Command::Tare);
            Ok(())
        }
        Ok(Request::UndoBaseline) => {
            command(shared, Command::UndoBaseline);
            Ok(())
        }
        Ok(Request::Clock { page_ms }) => {
            let clock = Clock {
                kind: "clock",
                page_ms,
                server_ms: shared.now_ms(),
            };
            let text = serde_json::to_string(&clock).unwrap_or_default();
            socket.send(Message::Text(text.into())).await
        }
        Err(error) => {
            tracing::debug!("a page asked for something unknown: {error}");
            Ok(())
        }
    }
}

/// Hands a command to the program, if there is room.
fn command(shared: &Shared, command: Command) {
    if shared.commands.try_send(command).is_err() {
        tracing::warn!("a page asked for {command:?}, but earlier requests are still waiting");
    }
}

fn scene_text(published: &Published, shared: &Shared) -> String {
    let scene = Scene::of(&published.picture, published.scene, shared.floor);
    serde_json::to_string(&scene).unwrap_or_default()
}
