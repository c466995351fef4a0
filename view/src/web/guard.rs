//! Who may talk to the page's server.
//!
//! The server listens on this computer alone, but a web page from anywhere runs in a browser on this computer. Two
//! checks keep such pages out: the `Host` a request names must be this computer (a name that was rebound to 127.0.0.1 is
//! not), and an `Origin`, which browsers always send with a WebSocket, must be the very page that this server serves.
//! Programs send no `Origin` and may connect.

use axum::extract::Request;
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Lets a request pass or answers 403 with the reason.
pub(super) async fn check(request: Request, next: Next) -> Response {
    match refusal(request.headers()) {
        None => next.run(request).await,
        Some(reason) => (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response(),
    }
}

/// Why a request with these headers is refused; none if it is not.
pub(super) fn refusal(headers: &HeaderMap) -> Option<&'static str> {
    let only = |name| {
        let mut values = headers.get_all(name).iter();
        let first = values.next().map(|v| v.to_str().ok());
        if values.next().is_some() { Some(None) } else { first }
    };
    let host = match only(header::HOST) {
        Some(Some(host)) if names_this_computer(host) => host,
        _ => {
            return Some("this page is served to this computer alone: open it as http://localhost or http://127.0.0.1");
        }
    };
    let own = |origin: &str| {
        origin
            .strip_prefix("http://")
            .is_some_and(|o| o.eq_ignore_ascii_case(host))
    };
    match only(header::ORIGIN) {
        None => None,
        Some(Some(origin)) if own(origin) => None,
        Some(_) => Some("another web page may not use this one"),
    }
}

/// Whether a `Host` header (name or address, perhaps with a port) is this computer. The port is free: it is another one
/// at the far end of an ssh tunnel.
fn names_this_computer(host: &str) -> bool {
    if let Ok(address) = host.parse::<std::net::SocketAddr>() {
        return address.ip().is_loopback();
    }
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !host.ends_with(']') => (name, port),
        _ => (host, "80"),
    };
    let bare = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
    let address = bare.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback());
    port.parse::<u16>().is_ok() && (address || name.eq_ignore_ascii_case("localhost"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(pairs: &[(header::HeaderName, &str)]) -> bool {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            headers.append(name.clone(), value.parse().unwrap());
        }
        refusal(&headers).is_some()
    }

    #[test]
    fn only_this_computer_is_a_host() {
        for host in [
            "127.0.0.1:8477",
            "localhost:9000",
            "LOCALHOST",
            "[::1]:8477",
            "[::1]",
            "127.0.0.1",
        ] {
            assert!(!refused(&[(header::HOST, host)]), "{host}");
        }
        let foreign = [
            "example.org",
            "example.org:8477",
            "127.0.0.1.example.org",
            "localhost.example.org:80",
        ];
        for host in foreign
            .into_iter()
            .chain(["192.168.1.5:8477", "localhost:x", "", "evil@localhost"])
        {
            assert!(refused(&[(header::HOST, host)]), "{host}");
        }
        assert!(refused(&[]));
        assert!(refused(&[(header::HOST, "localhost"), (header::HOST, "example.org")]));
    }

    #[test]
    fn only_the_own_page_is_an_origin() {
        let with = |host, origin| refused(&[(header::HOST, host), (header::ORIGIN, origin)]);
        assert!(!with("127.0.0.1:8477", "http://127.0.0.1:8477"));
        assert!(!with("localhost:9000", "http://localhost:9000"));
        assert!(with("127.0.0.1:8477", "https://example.org"));
        assert!(with("127.0.0.1:8477", "http://127.0.0.1:3000"));
        assert!(with("127.0.0.1:8477", "http://localhost:8477"));
        assert!(with("127.0.0.1:8477", "null"));
    }
}
