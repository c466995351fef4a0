//! What other pages, other users and broken programs do to the server; over real sockets.

use super::*;
use crate::web::connections::{HEADER_WAIT, MOST};
use crate::web::refused::Refused;

/// What the server answers to these bytes, until it closes the connection.
fn answer(address: SocketAddr, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(NOT_FOR_EVER)).unwrap();
    // It may close the connection before it has all of it.
    let _ = stream.write_all(bytes);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

const UPGRADE: &str = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n";

/// Every path there is, and some that are not.
const PATHS: [&str; 18] = [
    "/",
    "/style.css",
    "/main.js",
    "/theme.js",
    "/wire.js",
    "/field.js",
    "/sheet.js",
    "/labels.js",
    "/history.js",
    "/readings.js",
    "/shapes.js",
    "/trace.js",
    "/palettes.js",
    "/picture.png",
    "/live",
    "/nothing",
    "/favicon.ico",
    "/../secret",
];

fn status(head: &str) -> &str {
    head.split(' ').nth(1).unwrap_or("none")
}

#[test]
fn no_host_but_this_computer_and_no_origin_but_the_own_page() {
    let view = view();
    view.publish(picture(1)).unwrap();
    let port = view.server.address.port();
    let hosts = [
        "evil.com",
        "evil.com:8477",
        "127.0.0.1.evil.com",
        "127.0.0.1@evil.com",
        "localhost.",
        "localhost.evil.com",
        "127.1",
        "0x7f.1",
        "2130706433",
        "0.0.0.0",
        "[::ffff:127.0.0.1]",
        "[::]",
        "192.168.1.5",
        "localhost:99999",
        "localhost:-1",
        " ",
        "localhost, evil.com",
        "127.0.0.1:8477:8477",
        "..",
    ];
    for path in PATHS {
        for host in hosts.iter().map(|h| format!("Host: {h}\r\n")).chain([
            String::new(),
            "Host: localhost\r\nHost: evil.com\r\n".to_owned(),
            // A name that was rebound: page and server are of one origin.
            format!("Host: evil.com:{port}\r\nOrigin: http://evil.com:{port}\r\nSec-Fetch-Site: same-origin\r\n"),
        ]) {
            let head = answer(
                view.server.address,
                format!("GET {path} HTTP/1.1\r\nConnection: close\r\n{host}{UPGRADE}\r\n").as_bytes(),
            );
            assert!(matches!(status(&head), "403" | "400"), "{path} {host:?}: {head}");
        }
    }
    let own = format!("Host: 127.0.0.1:{port}\r\n");
    let old = answer(view.server.address, b"GET / HTTP/1.0\r\n\r\n");
    assert_eq!(status(&old), "403", "{old}");
    let origins = [
        "null",
        "",
        "http://evil.com",
        "https://evil.com",
        "http://localhost",
        "http://127.0.0.1",
        "http://127.0.0.1:1",
        "file://",
        "chrome-extension://abcdefgh",
        "moz-extension://abcdefgh",
        "http://127.0.0.1.evil.com",
        "ws://127.0.0.1",
        "127.0.0.1",
        "*",
    ];
    let foreign = origins.iter().map(|o| format!("Origin: {o}\r\n")).chain([
        format!("Origin: https://127.0.0.1:{port}\r\n"),
        format!("Origin: http://127.0.0.1:{port}\r\nOrigin: http://evil.com\r\n"),
        "Sec-Fetch-Site: cross-site\r\n".to_owned(),
        "Sec-Fetch-Site: same-site\r\n".to_owned(),
        "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: no-cors\r\nSec-Fetch-Dest: image\r\n".to_owned(),
        "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: navigate\r\nSec-Fetch-Dest: document\r\n".to_owned(),
    ]);
    for headers in foreign {
        for path in PATHS {
            let (head, _) = request(view.server.address, path, &format!("{own}{headers}{UPGRADE}"));
            assert_eq!(status(&head), "403", "{path} {headers:?}: {head}");
        }
    }
    assert_eq!(
        (view.clients(), view.shared.drawn.count.load(Ordering::Relaxed)),
        (0, 0),
        "no work was begun"
    );
}

#[test]
fn every_answer_is_for_the_own_origin_alone() {
    let view = view();
    view.publish(picture(1)).unwrap();
    let own = format!("Host: {}\r\n", view.server.address);
    for path in PATHS {
        for headers in [
            own.clone(),
            format!("{own}Sec-Fetch-Site: same-origin\r\n"),
            format!("{own}Sec-Fetch-Site: cross-site\r\n"),
        ] {
            let (head, _) = request(view.server.address, path, &headers);
            for line in [
                "cross-origin-resource-policy: same-origin",
                "x-content-type-options: nosniff",
                "referrer-policy: no-referrer",
                "cache-control: no-store",
                "frame-ancestors 'none'",
            ] {
                assert!(head.contains(line), "{path}: {line} is not in {head}");
            }
        }
    }
}

#[test]
fn what_is_no_request_for_the_page_changes_nothing() {
    let view = view();
    view.publish(picture(1)).unwrap();
    let own = format!("Host: {}\r\nConnection: close\r\n", view.server.address);
    for path in [
        "/../../etc/passwd",
        "/..%2f..%2fetc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/./main.js/..",
        "/main.js%00",
        "/.git/config",
        "/..\\..\\x",
        "/%",
        "/style.css/../../x",
    ] {
        let head = answer(
            view.server.address,
            format!("GET {path} HTTP/1.1\r\n{own}\r\n").as_bytes(),
        );
        assert!(matches!(status(&head), "404" | "400"), "{path}: {head}");
    }
    for method in ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH"] {
        for path in ["/", "/picture.png", "/live"] {
            let head = answer(
                view.server.address,
                format!("{method} {path} HTTP/1.1\r\n{own}\r\n").as_bytes(),
            );
            assert_eq!(status(&head), "405", "{method} {path}: {head}");
        }
    }
    let head = answer(
        view.server.address,
        format!("CONNECT evil.com:80 HTTP/1.1\r\n{own}\r\n").as_bytes(),
    );
    assert!(head.is_empty() || status(&head).starts_with('4'), "{head}");
    let many: String = (0..1000).map(|k| format!("X-{k}: y\r\n")).collect();
    let long = "y".repeat(200_000);
    let chunked = "Content-Length: 5\r\nTransfer-Encoding: chunked\r\n";
    for bytes in [
        format!("GET / HTTP/1.1\r\n{own}{many}\r\n"),
        format!("GET / HTTP/1.1\r\n{own}X: {long}\r\n\r\n"),
        format!("GET /{long} HTTP/1.1\r\n{own}\r\n"),
        format!("POST / HTTP/1.1\r\n{own}{chunked}\r\n0\r\n\r\nGET /picture.png HTTP/1.1\r\n{own}\r\n"),
        "garbage\r\n\r\n".to_owned(),
        "GET /\r\n\r\n".to_owned(),
        "GET / HTTP/9.9\r\n\r\n".to_owned(),
        "\0\0\0\0".to_owned(),
    ] {
        let head = answer(view.server.address, bytes.as_bytes());
        assert!(head.is_empty() || status(&head).starts_with(['4', '5']), "{head}");
    }
    let head = answer(view.server.address, b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03");
    assert!(head.is_empty() || status(&head) == "400", "{head}");
    // A body that nobody reads.
    let mut huge = format!("POST / HTTP/1.1\r\n{own}Content-Length: 100000000\r\n\r\n").into_bytes();
    huge.resize(huge.len() + 5_000_000, b'x');
    assert_eq!(status(&answer(view.server.address, &huge)), "405");
    assert_eq!(
        (
            view.command(),
            view.clients(),
            view.shared.drawn.count.load(Ordering::Relaxed)
        ),
        (None, 0, 0)
    );
    assert!(request(view.server.address, "/", &own).0.starts_with("HTTP/1.1 200"));
}

#[test]
fn messages_that_are_no_pages_end_at_most_their_own_connection() {
    let view = view();
    let mut good = connect(view.server.address);
    let texts = [
        "",
        "{}",
        "[]",
        "null",
        "1e999",
        r#"{"kind":1}"#,
        r#"{"kind":"clock","page_ms":"x"}"#,
        r#"{"kind":"clock","page_ms":1e999}"#,
        r#"{"kind":"enter","key":7}"#,
        r#"{"kind":"enter"}"#,
        r#"{"kind":"shutdown"}"#,
        r#"{"kind":"tare","token":"guessed"}"#,
        r#"{"kind":"undo_baseline"}"#,
        r#"{"kind":"tare","x":1}"#,
    ];
    for text in texts {
        let mut page = connect(view.server.address);
        page.send(Message::Text(text.into())).unwrap();
        // It is still served.
        let rights = enter(&mut page, "guessed");
        assert_eq!(rights["token"], serde_json::Value::Null, "{text}");
    }
    let closes = |what: &str, message: Message| {
        let mut page = connect(view.server.address);
        let _ = page.send(message);
        let end = loop {
            match page.read() {
                Ok(Message::Close(_)) | Err(_) => break true,
                Ok(_) => {}
            }
        };
        assert!(end, "{what}");
    };
    closes("a long message", Message::Text("x".repeat(2000).into()));
    closes("an acknowledgement of nothing", Message::Binary(vec![1].into()));
    let mut page = connect(view.server.address);
    // Not UTF-8, in a text frame, masked with zeros.
    page.get_mut().write_all(&[0x81, 0x82, 0, 0, 0, 0, 0xff, 0xfe]).unwrap();
    while !matches!(page.read(), Ok(Message::Close(_)) | Err(_)) {}
    assert_eq!(view.command(), None, "nobody without the token commands");
    eventually("their places are free", || view.clients() == 1);
    view.publish(picture(7)).unwrap();
    assert_eq!(next_frame(&mut good).0.sequence, 7);
}

#[test]
fn another_user_may_watch_but_never_command() {
    let view = view();
    view.publish(picture(1)).unwrap();
    let mut page = connect(view.server.address);
    next_frame(&mut page);
    for _ in 0..20 {
        page.send(Message::Text(r#"{"kind":"tare"}"#.into())).unwrap();
    }
    assert_eq!(enter(&mut page, "")["token"], serde_json::Value::Null);
    eventually("all are counted", || {
        view.shared.refused.waiting(Refused::Command) == 20
    });
    assert_eq!(view.command(), None);
    // No page, picture or scene tells the token.
    let token = view.shared.keys.token();
    let host = format!("Host: {}\r\n", view.server.address);
    for path in PATHS {
        let (head, body) = request(view.server.address, path, &host);
        assert!(
            !format!("{head}{}", String::from_utf8_lossy(&body)).contains(token),
            "{path}"
        );
    }
}

#[test]
fn a_flood_is_cut_off_and_counted_once() {
    let view = view();
    let mut page = connect(view.server.address);
    assert_eq!(enter(&mut page, key_of(&view.url()))["token"], view.shared.keys.token());
    for _ in 0..2000 {
        if page.send(Message::Text(r#"{"kind":"tare"}"#.into())).is_err() {
            break;
        }
    }
    while !matches!(page.read(), Ok(Message::Close(_)) | Err(_)) {}
    let waiting = std::iter::from_fn(|| view.command()).count() as u64;
    let [excess, floods] = [Refused::Excess, Refused::Flood].map(|r| view.shared.refused.waiting(r));
    // One warning comes of it, five seconds later; a slow machine may have said it already.
    assert!(
        waiting <= WAITING_COMMANDS as u64 && excess + waiting <= 50 && floods <= 1,
        "{waiting} {excess} {floods}"
    );
}

#[test]
fn a_picture_is_drawn_once_for_all_who_ask() {
    let view = view();
    view.publish(picture(1)).unwrap();
    let host = format!("Host: {}\r\n", view.server.address);
    let asked = |count: usize| {
        let gate = std::sync::Barrier::new(count);
        let bodies: Vec<Vec<u8>> = std::thread::scope(|scope| {
            let ask = || {
                gate.wait();
                let (head, body) = request(view.server.address, "/picture.png", &host);
                assert!(head.starts_with("HTTP/1.1 200"), "{head}");
                body
            };
            let threads: Vec<_> = (0..count).map(|_| scope.spawn(ask)).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert!(bodies.iter().all(|b| b.starts_with(b"\x89PNG")));
        bodies
    };
    // As long as the picture stays, there is one drawing.
    let bodies = asked(60);
    assert!(bodies.iter().all(|b| *b == bodies[0]));
    let drawn = || view.shared.drawn.count.load(Ordering::Relaxed);
    assert_eq!(drawn(), 1);
    // While it moves, one serves all who came before it was begun: whoever asks gets one of three at most.
    view.publish(picture(2)).unwrap();
    asked(60);
    assert!(drawn() <= 4, "{}", drawn());
    // Askers that go away leave no drawing behind that nobody uses.
    view.publish(picture(3)).unwrap();
    for _ in 0..50 {
        let mut stream = TcpStream::connect(view.server.address).unwrap();
        write!(stream, "GET /picture.png HTTP/1.1\r\n{host}\r\n").unwrap();
    }
    asked(1);
    assert!(drawn() <= 7, "{}", drawn());
}

#[test]
fn no_more_connections_than_there_are_places_and_half_requests_give_theirs_back() {
    let view = view();
    let start = Instant::now();
    let mut half: Vec<TcpStream> = (0..MOST)
        .map(|_| {
            let mut stream = TcpStream::connect(view.server.address).unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nHost: loc").unwrap();
            stream
        })
        .collect();
    let host = format!("Host: {}\r\n", view.server.address);
    let mut refused = 0;
    // Until their time is over nobody else is served, and that is said at once.
    loop {
        let (head, body) = request(view.server.address, "/", &host);
        if head.starts_with("HTTP/1.1 200") {
            break;
        }
        assert!(
            head.starts_with("HTTP/1.1 503") && body.starts_with(b"this page is open too often"),
            "{head}"
        );
        refused += 1;
        assert!(start.elapsed() < NOT_FOR_EVER, "the places are not given back");
    }
    assert!(refused > 0 && start.elapsed() >= HEADER_WAIT);
    for stream in &mut half {
        stream.set_read_timeout(Some(NOT_FOR_EVER)).unwrap();
        // The end, perhaps after a word of reproach.
        let _ = stream.read_to_end(&mut Vec::new());
    }
    // Pages that are shown keep theirs, and give them back when they go.
    let pages: Vec<Page> = (0..MOST).map(|_| connect(view.server.address)).collect();
    eventually("all are counted", || view.clients() == MOST);
    assert!(request(view.server.address, "/", &host).0.starts_with("HTTP/1.1 503"));
    drop(pages);
    eventually("all have gone", || view.clients() == 0);
    assert!(request(view.server.address, "/", &host).0.starts_with("HTTP/1.1 200"));
}
