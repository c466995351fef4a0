//! Who may talk to the page's server.
//!
//! The server listens on this computer alone, but a web page from anywhere runs in a browser on this computer. Three checks keep such
//! pages out: the `Host` a request names must be this computer (a name that was rebound to 127.0.0.1 is not). An `Origin`, which browsers
//! always send with a WebSocket, must be the very page that this server serves. And `Sec-Fetch-Site`, which browsers send with whatever a
//! page asks for, must be that of this page, or of an address that somebody typed in. Programs send neither and may connect.
//!
//! Answers, refusals too, are for the own origin alone: a page from elsewhere cannot tell them from those of a port where nobody listens.

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Nothing from elsewhere, and no place in another page's frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// What every answer says of itself.
const OF_EVERY_ANSWER: [(HeaderName, &str); 5] = [
    // A newer program must not be shown through an older page.
    (header::CACHE_CONTROL, "no-store"),
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Lets a request pass or answers 403 with the reason.
pub(super) async fn check(request: Request, next: Next) -> Response {
    let mut response = match refusal(request.headers()) {
        None => next.run(request).await,
        Some(reason) => (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response(),
    };
    for (name, value) in OF_EVERY_ANSWER {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
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
    let origin = only(header::ORIGIN).is_none_or(|origin| origin.is_some_and(own));
    let site = only(FETCH_SITE).is_none_or(|site| matches!(site, Some("same-origin" | "none")));
    (!origin || !site).then_some("another web page may not use this one; type its address in")
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

    #[test]
    fn only_the_own_page_and_a_typed_address_fetch() {
        let host = (header::HOST, "127.0.0.1:8477");
        for (site, is_refused) in [
            ("same-origin", false),
            ("none", false),
            // Another program's page on this computer.
            ("same-site", true),
            ("cross-site", true),
            ("", true),
            ("whatever comes", true),
        ] {
            assert_eq!(refused(&[host.clone(), (FETCH_SITE, site)]), is_refused, "{site}");
        }
        assert!(refused(&[host, (FETCH_SITE, "none"), (FETCH_SITE, "cross-site")]));
    }
}
