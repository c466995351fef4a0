//! What the server has to give: the page's files, the WebSocket, the picture as a PNG.

use std::net::TcpListener;
use std::sync::Arc;

use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::get;
use axum::{Router, middleware};
use tokio::sync::watch;

use crate::palette::Palette;
use crate::web::app::App;
use crate::web::{Shared, connections, drawn, guard, watcher};

/// The longest message taken from a page, bytes.
const LONGEST_REQUEST: usize = 1024;

/// Path, media type and text of the page's files.
const FILES: [(&str, &str, &str); 12] = [
    ("/", HTML, include_str!("../page/index.html")),
    (
        "/style.css",
        "text/css; charset=utf-8",
        include_str!("../page/style.css"),
    ),
    ("/theme.js", JS, include_str!("../page/theme.js")),
    ("/main.js", JS, include_str!("../page/main.js")),
    ("/wire.js", JS, include_str!("../page/wire.js")),
    ("/field.js", JS, include_str!("../page/field.js")),
    ("/sheet.js", JS, include_str!("../page/sheet.js")),
    ("/labels.js", JS, include_str!("../page/labels.js")),
    ("/readings.js", JS, include_str!("../page/readings.js")),
    ("/shapes.js", JS, include_str!("../page/shapes.js")),
    ("/history.js", JS, include_str!("../page/history.js")),
    ("/trace.js", JS, include_str!("../page/trace.js")),
];
const HTML: &str = "text/html; charset=utf-8";
const JS: &str = "text/javascript; charset=utf-8";

/// Serves until `stopped` turns true, and a little longer for the farewell.
pub(super) async fn serve(
    listener: TcpListener,
    pages: Arc<[Arc<Shared>]>,
    stopped: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let names: Vec<String> = pages.iter().filter_map(|page| page.name.clone()).collect();
    let mut router = Router::new();
    for (page, shared) in pages.iter().enumerate() {
        router = routes(router, page, shared.name.as_deref(), &names);
    }
    if let Some(first) = names.first() {
        // What stands behind the # goes with it.
        let first = format!("/{first}/");
        router = router.route("/", get(|| async move { Redirect::temporary(&first) }));
    }
    let router = router.layer(middleware::from_fn(guard::check));
    connections::serve(listener, router, Arc::clone(&pages), stopped).await;
    if let Some(first) = pages.first() {
        first.refused.say();
    }
    Ok(())
}

/// What a page asks for: at the root, or below its skin's name where there are several.
fn routes(router: Router<App>, page: usize, name: Option<&str>, names: &[String]) -> Router<App> {
    let at = |path: &str| name.map_or_else(|| path.to_owned(), |name| format!("/{name}{path}"));
    let files = FILES.into_iter().fold(router, |router, (path, media, text)| {
        let text = match media {
            HTML => text.replacen(SKINS, &links(name, names), 1),
            _ => text.to_owned(),
        };
        router.route(&at(path), get(move || async move { file(media, text) }))
    });
    files
        .route(&at("/palettes.js"), get(|| async { file(JS, palettes()) }))
        .route(
            &at("/picture.png"),
            get(move |State(app): State<App>| picture(app.of(page))),
        )
        .route(
            &at("/live"),
            get(move |upgrade: WebSocketUpgrade, State(app): State<App>| live(upgrade, app.of(page))),
        )
}

/// Where the names of the skins stand in the page.
const SKINS: &str = "<!-- skins -->";

/// The names of the skins, to switch between them; nothing where there is one. Names have no letter that HTML would take for its own
/// ([`is_name`](crate::web::is_name)).
fn links(shown: Option<&str>, names: &[String]) -> String {
    let Some(shown) = shown else { return String::new() };
    let link = |name: &String| {
        let current = if name == shown { " aria-current=\"page\"" } else { "" };
        format!("<a href=\"../{name}/\"{current}>{name}</a>")
    };
    let links: String = names.iter().map(link).collect();
    format!("<nav id=\"skins\" aria-label=\"Skins\">{links}</nav>")
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
async fn picture(app: App) -> Response {
    // On its own, so that it goes on if the asker goes.
    match tokio::spawn(drawn::newest(Arc::clone(&app.shared))).await {
        Ok(Ok(Some(png))) => ([(header::CONTENT_TYPE, "image/png")], png).into_response(),
        Ok(Ok(None)) => (StatusCode::NOT_FOUND, "no picture yet\n").into_response(),
        Ok(Err(error)) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
        Err(_) => (StatusCode::INTERNAL_SERVER_ERROR, "the picture could not be drawn\n").into_response(),
    }
}

async fn live(upgrade: WebSocketUpgrade, app: App) -> Response {
    upgrade
        .max_message_size(LONGEST_REQUEST)
        .max_frame_size(LONGEST_REQUEST)
        .on_upgrade(move |socket| watcher::show(socket, app))
}
