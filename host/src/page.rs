//! The live page of `skin run` and `skin replay`.

use crate::config::Config;
use crate::run_arguments::ShowArguments;
use anyhow::{Context, Result};
use std::io::IsTerminal;
use std::net::{Ipv4Addr, SocketAddr};
use view::web::{DEFAULT_PORT, LiveOptions as PageOptions, LiveView};

/// Serves the page, says where, and opens it on a desktop.
///
/// # Errors
/// It cannot be served.
pub(crate) fn page(arguments: &ShowArguments) -> Result<LiveView> {
    let mut pages = serve(arguments, |options| Ok(vec![LiveView::start(options)?]))?;
    pages.pop().context("the page cannot be served")
}

/// The pages of several skins, in their order.
///
/// # Errors
/// They cannot be served.
pub(crate) fn pages(arguments: &ShowArguments, names: &[&str]) -> Result<Vec<LiveView>> {
    serve(arguments, |options| LiveView::start_named(options, names))
}

fn serve(
    arguments: &ShowArguments,
    start: impl Fn(PageOptions) -> std::io::Result<Vec<LiveView>>,
) -> Result<Vec<LiveView>> {
    let options = |port| PageOptions {
        listen: SocketAddr::from((Ipv4Addr::LOCALHOST, port)),
        ..PageOptions::default()
    };
    let config = Config::load()?;
    let pages = match arguments.listen.or(config.listen) {
        Some(port) => start(options(port)),
        None => start(options(DEFAULT_PORT)).or_else(|_| start(options(0))),
    }
    .context("the page cannot be served")?;
    let Some(page) = pages.first() else { return Ok(pages) };
    // Not with `say!`: the token in it has no place in a recording, which others may read.
    eprintln!("live picture: {}   (Ctrl-C ends)", page.url());
    let shown = |name: &&str| std::env::var_os(name).is_some();
    let (desktop, open): (bool, &[&str]) = if cfg!(windows) {
        (true, &["rundll32", "url.dll,FileProtocolHandler"])
    } else if cfg!(target_os = "macos") {
        (true, &["open"])
    } else {
        (["DISPLAY", "WAYLAND_DISPLAY"].iter().any(shown), &["xdg-open"])
    };
    let wanted = !arguments.no_open && config.open.unwrap_or(true);
    if desktop && wanted && std::io::stderr().is_terminal() {
        // Only a convenience: whoever has no such program has the URL.
        let _ = std::process::Command::new(open[0])
            .args(&open[1..])
            .arg(page.url_once()?)
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn();
    }
    Ok(pages)
}
