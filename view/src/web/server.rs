//! What the server has to give: the page's files, the WebSocket, the picture as a PNG.

use std::net::TcpListener;
use std::sync::Arc;

use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Router, middleware};
use tokio::sync::watch;

use crate::palette::Palette;
use crate::web::app::App;
use crate::web::{Shared, connections, drawn, guard, watcher};

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
    let router = files
        .route("/palettes.js", get(|| async { file(JS, palettes()) }))
        .route("/picture.png", get(picture))
        .route("/live", get(live))
        .layer(middleware::from_fn(guard::check));
    connections::serve(listener, router, Arc::clone(&shared), stopped).await;
    shared.refused.say();
    Ok(())
}

fn file(media: &'static str, text: String) -> Response {
    ([(header::CONTENT_TYPE, HeaderValue::from_static(media))], text).into_response()
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
    // On its own, so that it goes on if the asker goes.
    match tokio::spawn(drawn::newest(Arc::clone(&app.shared))).await {
        Ok(Ok(Some(png))) => ([(header::CONTENT_TYPE, "image/png")], png).into_response(),
        Ok(Ok(None)) => (StatusCode::NOT_FOUND, "no picture yet\n").into_response(),
        Ok(Err(error)) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
        Err(_) => (StatusCode::INTERNAL_SERVER_ERROR, "the picture could not be drawn\n").into_response(),
    }
}

async fn live(upgrade: WebSocketUpgrade, State(app): State<App>) -> Response {
    upgrade
        .max_message_size(LONGEST_REQUEST)
        .max_frame_size(LONGEST_REQUEST)
        .on_upgrade(move |socket| watcher::show(socket, app))
}
