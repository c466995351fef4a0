//! The server as a page and as a hostile neighbour see it.

use std::io::{Read, Write};
use std::net::TcpStream;

use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use super::*;
use crate::wire::tests::picture;

type Page = WebSocket<TcpStream>;

fn view() -> LiveView {
    LiveView::start(LiveOptions {
        listen: "127.0.0.1:0".parse().unwrap(),
        ..LiveOptions::default()
    })
    .unwrap()
}

/// Longer than the slowest machine needs for what is done at once.
const NOT_FOR_EVER: Duration = Duration::from_secs(30);

fn connect(address: SocketAddr) -> Page {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    tungstenite::client(format!("ws://{address}/live"), stream).unwrap().0
}

/// The next frame and the texts before it; not acknowledged.
fn next_frame(page: &mut Page) -> (wire::Frame, Vec<serde_json::Value>) {
    let mut texts = Vec::new();
    loop {
        match page.read().unwrap() {
            Message::Binary(bytes) => return (wire::decode(&bytes).unwrap(), texts),
            Message::Text(text) => texts.push(serde_json::from_str(&text).unwrap()),
            other => panic!("{other:?}"),
        }
    }
}

fn acknowledge(page: &mut Page) {
    page.send(Message::Binary(vec![1].into())).unwrap();
}

/// What the page's address ends with.
fn key_of(url: &str) -> &str {
    url.split_once('#').unwrap().1
}

/// Shows the server a key; its answer.
fn enter(page: &mut Page, key: &str) -> serde_json::Value {
    let text = serde_json::json!({ "kind": "enter", "key": key }).to_string();
    page.send(Message::Text(text.into())).unwrap();
    loop {
        if let Message::Text(text) = page.read().unwrap() {
            let answer: serde_json::Value = serde_json::from_str(&text).unwrap();
            if answer["kind"] == "rights" {
                return answer;
            }
        }
    }
}

/// Waits for something that other threads are about to do.
fn eventually(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < NOT_FOR_EVER, "never: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Status line and body of a request with these header lines.
fn request(address: SocketAddr, path: &str, headers: &str) -> (String, Vec<u8>) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nConnection: close\r\n{headers}\r\n").unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
    (
        String::from_utf8(bytes[..end].to_vec()).unwrap(),
        bytes[end + 4..].to_vec(),
    )
}

#[test]
fn the_page_and_its_parts_are_served() {
    let view = view();
    let host = format!("Host: {}\r\n", view.server.address);
    let (head, body) = request(view.server.address, "/", &host);
    assert!(
        head.starts_with("HTTP/1.1 200") && head.contains("frame-ancestors 'none'"),
        "{head}"
    );
    let page = String::from_utf8(body).unwrap();
    // Every part that the page names is there, and nothing comes from elsewhere.
    let parts: Vec<&str> = page
        .split(['"', '\''])
        .filter(|s| s.ends_with(".js") || s.ends_with(".css"))
        .collect();
    assert!(parts.len() >= 2, "{parts:?}");
    for part in parts.into_iter().chain([
        "palettes.js",
        "wire.js",
        "field.js",
        "sheet.js",
        "labels.js",
        "history.js",
        "readings.js",
        "shapes.js",
        "trace.js",
    ]) {
        let (head, body) = request(
            view.server.address,
            &format!("/{}", part.trim_start_matches("./")),
            &host,
        );
        assert!(head.starts_with("HTTP/1.1 200") && !body.is_empty(), "{part}: {head}");
        assert!(!String::from_utf8_lossy(&body).contains("//cdn"));
    }
    // The one address in it names the language of the icon.
    assert!(!page.replace("http://www.w3.org/2000/svg", "").contains("://"));
    assert!(
        request(view.server.address, "/picture.png", &host)
            .0
            .starts_with("HTTP/1.1 404")
    );
    view.publish(picture(1)).unwrap();
    let (head, body) = request(view.server.address, "/picture.png", &host);
    assert!(head.contains("image/png") && body.starts_with(b"\x89PNG"), "{head}");
}

#[test]
fn several_skins_have_a_page_each_and_a_row_of_their_names() {
    let options = LiveOptions {
        listen: SocketAddr::from(([127, 0, 0, 1], 0)),
        ..LiveOptions::default()
    };
    let views = LiveView::start_named(options, &["left", "right_2"]).unwrap();
    let address = views[0].server.address;
    let host = format!("Host: {address}\r\n");
    let (head, _) = request(address, "/", &host);
    assert!(
        head.starts_with("HTTP/1.1 307") && head.contains("location: /left/\r\n"),
        "{head}"
    );
    for (shown, other) in [("left", "right_2"), ("right_2", "left")] {
        let (head, body) = request(address, &format!("/{shown}/"), &host);
        let page = String::from_utf8(body).unwrap();
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        assert!(page.contains(&format!("<a href=\"../{shown}/\" aria-current=\"page\">{shown}</a>")));
        assert!(page.contains(&format!("<a href=\"../{other}/\">{other}</a>")));
        for part in ["main.js", "wire.js", "style.css", "palettes.js"] {
            let (head, _) = request(address, &format!("/{shown}/{part}"), &host);
            assert!(head.starts_with("HTTP/1.1 200"), "{part}: {head}");
        }
        let (head, _) = request(address, &format!("/{shown}/"), "Host: elsewhere.example\r\n");
        assert!(head.starts_with("HTTP/1.1 403"), "{head}");
    }
    // A picture is one skin's.
    views[1].publish(picture(1)).unwrap();
    let status = |path: &str| request(address, path, &host).0[9..12].to_owned();
    assert_eq!(status("/right_2/picture.png"), "200");
    assert_eq!(status("/left/picture.png"), "404");
    assert_eq!(status("/middle/"), "404");
    // The other page is served on where one has gone.
    let mut views = views;
    views.pop();
    assert_eq!(status("/left/"), "200");
    drop(views);
    assert!(TcpStream::connect(address).is_err());
    for names in [&["a", "a"][..], &["a b"], &[""], &["<b>"]] {
        let refused = LiveView::start_named(options, names).err().unwrap();
        assert_eq!(refused.kind(), io::ErrorKind::InvalidInput, "{names:?}");
    }
    // A page of one skin has no row.
    let alone = view();
    let (_, body) = request(
        alone.server.address,
        "/",
        &format!("Host: {}\r\n", alone.server.address),
    );
    assert!(!String::from_utf8(body).unwrap().contains("id=\"skins\""));
}

#[test]
fn strangers_are_refused() {
    let view = view();
    let upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n";
    let own = view.server.address;
    let cases = [
        ("/", "Host: rebound.example.org\r\n".to_owned()),
        ("/picture.png", format!("Host: rebound.example.org:{}\r\n", own.port())),
        (
            "/live",
            format!("Host: {own}\r\nOrigin: https://example.org\r\n{upgrade}"),
        ),
        (
            "/live",
            format!("Host: {own}\r\nOrigin: http://127.0.0.1:1\r\n{upgrade}"),
        ),
        (
            "/live",
            format!("Host: example.org\r\nOrigin: http://example.org\r\n{upgrade}"),
        ),
    ];
    for (path, headers) in cases {
        let (head, body) = request(own, path, &headers);
        assert!(
            head.starts_with("HTTP/1.1 403") && !body.is_empty(),
            "{path} {headers}: {head}"
        );
    }
    assert_eq!(view.clients(), 0);
    // The own page and a program without an origin are let in.
    let mut page = format!("ws://{own}/live").into_client_request().unwrap();
    page.headers_mut()
        .insert("Origin", format!("http://{own}").parse().unwrap());
    tungstenite::client(page, TcpStream::connect(own).unwrap()).unwrap();
    connect(own);
}

#[test]
fn a_page_gets_the_scene_once_and_then_frames() {
    let view = view();
    view.publish(picture(10)).unwrap();
    let mut page = connect(view.server.address);
    let (frame, texts) = next_frame(&mut page);
    assert_eq!((frame.sequence, frame.scene, texts.len()), (10, 1, 1));
    assert_eq!(
        (&texts[0]["kind"], &texts[0]["source"]),
        (&"scene".into(), &"simulated skin".into())
    );
    let cells = texts[0]["cells"].as_array().unwrap().len();
    assert_eq!(cells, picture(10).values.len());
    assert_eq!((frame.base, wire::Cells::new(cells).take(&frame)), (0, Some(())));
    // An equal sheet at another address is the same scene; another source is not.
    view.publish(picture(11)).unwrap();
    let (frame, texts) = next_frame(&mut page);
    assert_eq!((frame.sequence, texts.len()), (11, 0));
    // It shows the same, so there is no cell to tell.
    assert_eq!((frame.base, frame.runs.len()), (1, 0));
    let mut other = picture(12);
    other.stats.source = "/dev/ttyUSB0".into();
    acknowledge(&mut page);
    view.publish(other).unwrap();
    let (frame, texts) = next_frame(&mut page);
    assert_eq!(
        (frame.sequence, frame.scene, &texts[0]["source"]),
        (12, 2, &"/dev/ttyUSB0".into())
    );
    assert_eq!(view.clients(), 1);
}

#[test]
fn a_page_without_credit_skips_to_the_newest() {
    let view = view();
    let (mut slow, mut quick) = (connect(view.server.address), connect(view.server.address));
    for sequence in 0..100 {
        view.publish(picture(sequence)).unwrap();
        assert_eq!(next_frame(&mut quick).0.sequence, sequence);
        acknowledge(&mut quick);
        // As long as it has credit the slow page gets them too; then it takes no more.
        if sequence < 2 {
            assert_eq!(next_frame(&mut slow).0.sequence, sequence);
        }
    }
    acknowledge(&mut slow);
    let (last, _) = next_frame(&mut slow);
    assert_eq!((last.sequence, last.base), (99, 2));
    // Both pages together needed every picture encoded once, and the last one also for a page that lags.
    assert_eq!(view.shared.encoded.load(Ordering::Relaxed), 101);
}

#[test]
fn quick_slow_and_late_pages_put_the_same_picture_together() {
    let view = view();
    let mut at = picture(0);
    let mut pages: Vec<(Page, wire::Cells)> = Vec::new();
    for round in 0..6 {
        pages.push((connect(view.server.address), wire::Cells::new(at.values.len())));
        for step in 0..20 {
            at.sequence += 1;
            // Something moves about on the sheet.
            let moved = (37 * at.sequence as usize + step) % at.values.len();
            at.values[moved] = 0.3 - at.values[moved];
            view.publish(at.clone()).unwrap();
        }
        for (k, (page, cells)) in pages.iter_mut().enumerate() {
            // Some lag by rounds.
            if (round + k) % (k + 1) == 0 || round == 5 {
                while {
                    let (frame, _) = next_frame(page);
                    acknowledge(page);
                    cells.take(&frame).unwrap();
                    frame.sequence < at.sequence
                } {}
                let latest = view.shared.latest.borrow();
                assert_eq!(cells.steps(), latest.as_ref().unwrap().shown.steps());
            }
        }
    }
}

#[test]
fn publishing_to_nobody_encodes_nothing() {
    let view = view();
    let pictures = 2_000;
    let template = picture(0);
    for sequence in 0..pictures {
        view.publish(Picture {
            sequence,
            ..template.clone()
        })
        .unwrap();
    }
    assert_eq!(view.shared.encoded.load(Ordering::Relaxed), 0);
}

#[test]
fn a_page_that_never_reads_blocks_nobody() {
    let view = view();
    let _deaf = connect(view.server.address);
    eventually("the page is counted", || view.clients() == 1);
    for sequence in 0..2_000 {
        view.publish(picture(sequence)).unwrap();
    }
    assert!(view.shared.encoded.load(Ordering::Relaxed) <= 2);
}

#[test]
fn pages_come_back_after_a_restart_and_commands_arrive() {
    let first = view();
    let address = first.server.address;
    let first_url = first.url();
    let first_token = key_of(&first_url);
    let mut page = connect(address);
    eventually("the page is counted", || first.clients() == 1);
    let start = Instant::now();
    drop(first);
    assert!(start.elapsed() < NOT_FOR_EVER, "{:?}", start.elapsed());
    assert!(matches!(page.read(), Ok(Message::Close(_))), "the page is told");
    let second = LiveView::start(LiveOptions {
        listen: address,
        ..LiveOptions::default()
    })
    .unwrap();
    let mut page = connect(address);
    second.publish(picture(5)).unwrap();
    assert_eq!(next_frame(&mut page).0.sequence, 5);
    page.send(Message::Text("nonsense".into())).unwrap();
    // The address of the program before is good for nothing, that of a browser once.
    assert_eq!(enter(&mut page, first_token)["token"], serde_json::Value::Null);
    let ticket = second.url_once().unwrap();
    let token = second.shared.keys.token();
    assert_eq!(enter(&mut page, key_of(&ticket))["token"], token);
    assert_eq!(enter(&mut page, key_of(&ticket))["token"], serde_json::Value::Null);
    assert_eq!(enter(&mut page, key_of(&second.url()))["token"], token);
    page.send(Message::Text(r#"{"kind":"tare"}"#.into())).unwrap();
    let mut command = None;
    eventually("the command arrives", || {
        command = second.command();
        command.is_some()
    });
    assert_eq!((command, second.command()), (Some(Command::Tare), None));
    page.send(Message::Text(r#"{"kind":"undo_baseline"}"#.into())).unwrap();
    eventually("the undo arrives", || {
        command = second.command();
        command.is_some()
    });
    assert_eq!(command, Some(Command::UndoBaseline));
    page.send(Message::Text(r#"{"kind":"clock","page_ms":1.5}"#.into()))
        .unwrap();
    let answer = page.read().unwrap().into_text().unwrap();
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert!(
        answer["page_ms"] == 1.5 && answer["server_ms"].as_f64().unwrap() > 0.0,
        "{answer}"
    );
    drop(page);
    eventually("the page is gone", || second.clients() == 0);
}

#[test]
fn stopping_does_not_wait_for_a_stuck_page_or_a_half_request() {
    let view = view();
    let mut stuck = connect(view.server.address);
    view.publish(picture(1)).unwrap();
    next_frame(&mut stuck);
    let mut half = TcpStream::connect(view.server.address).unwrap();
    half.write_all(b"GET / HTTP/1.1\r\nHost: loc").unwrap();
    let start = Instant::now();
    drop(view);
    assert!(start.elapsed() < NOT_FOR_EVER, "{:?}", start.elapsed());
}

#[test]
fn errors_say_what_to_do() {
    let view = view();
    let error = |listen| {
        LiveView::start(LiveOptions {
            listen,
            ..LiveOptions::default()
        })
        .map(|v| v.url())
        .unwrap_err()
    };
    let taken = error(view.server.address);
    assert_eq!(taken.kind(), io::ErrorKind::AddrInUse);
    assert!(taken.to_string().contains("another port"), "{taken}");
    let open = error("0.0.0.0:0".parse().unwrap());
    assert_eq!(open.kind(), io::ErrorKind::InvalidInput);
    assert!(open.to_string().contains("ssh -L"), "{open}");
    let mut bad = picture(0);
    bad.values.pop();
    assert!(view.publish(bad).is_err());
}

#[test]
fn one_frame_is_the_same_for_the_page_and_for_us() {
    // The page's reader is written by hand: what it takes from where must be what is written.
    let reader = include_str!("../page/wire.js");
    for at in [
        "getUint32(4",
        "getBigUint64(8",
        "getFloat64(16",
        "getFloat64(24",
        "getFloat32(44",
        "getBigUint64(72",
        "getUint16(86",
    ] {
        assert!(reader.contains(at), "{at}");
    }
}

#[path = "hostile_tests.rs"]
mod hostile;

#[test]
fn a_page_is_told_where_to_press_and_only_one_with_the_token_repeats_or_skips() {
    let view = view();
    let guide = Guide {
        mark_mm: Some([12.5, -30.0]),
        taken_mm: vec![[1.0, 2.0]],
        count: 20,
        text: "press 2 of 20".to_owned(),
        note: String::new(),
    };
    view.set_guide(guide);
    let mut page = connect(view.server.address);
    view.publish(picture(1)).unwrap();
    // A page that comes later is told, too.
    let told = next_frame(&mut page).1.into_iter().find(|text| text["kind"] == "guide");
    let told = told.unwrap_or_else(|| {
        acknowledge(&mut page);
        view.publish(picture(2)).unwrap();
        let texts = next_frame(&mut page).1;
        texts.into_iter().find(|text| text["kind"] == "guide").unwrap()
    });
    assert_eq!(told["mark_mm"], serde_json::json!([12.5, -30.0]));
    assert_eq!((&told["count"], &told["text"]), (&20.into(), &"press 2 of 20".into()));
    page.send(Message::Text(r#"{"kind":"repeat_press"}"#.into())).unwrap();
    let refused = loop {
        if let Message::Text(text) = page.read().unwrap() {
            let answer: serde_json::Value = serde_json::from_str(&text).unwrap();
            if answer["kind"] == "rights" {
                break answer;
            }
        }
    };
    assert!(refused["token"].is_null() && view.command().is_none(), "{refused}");
    enter(&mut page, key_of(&view.url()));
    for (kind, command) in [
        ("repeat_press", Command::RepeatPress),
        ("skip_press", Command::SkipPress),
    ] {
        page.send(Message::Text(format!(r#"{{"kind":"{kind}"}}"#).into()))
            .unwrap();
        let mut taken = None;
        eventually("the command arrives", || {
            taken = view.command();
            taken.is_some()
        });
        assert_eq!(taken, Some(command));
    }
}
