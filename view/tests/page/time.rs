//! What was seen before, what is saved of it, and the cells one by one.

use super::*;
use serde_json::json;
use view::web::{Command, Replay};

/// Until what the page was told is drawn.
const DRAWN: &str = "new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))";
const SEQUENCE: &str = "Number(document.querySelector('#sequence').textContent)";

/// Publishes pictures one after another until an expression of the page is true.
fn until(page: &mut Page, view: &LiveView, sequence: &mut u64, expression: &str) {
    let end = Instant::now() + NOT_FOR_EVER;
    while page.ask(expression) != true {
        assert!(Instant::now() < end, "never: {expression}");
        *sequence += 1;
        view.publish(picture(&template(), *sequence)).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The number of the frame that is shown; its touches are those of that frame.
fn shown(page: &mut Page) -> u64 {
    page.ask(DRAWN);
    let is = page.ask("[...document.querySelector('#touches').rows].map((row) => row.cells[1].textContent + ' ' + row.cells[2].textContent)");
    let sequence = page.ask(SEQUENCE).as_u64().unwrap();
    let touches = picture(&template(), sequence).strongest_first();
    let tenth = |v: f64| {
        format!("{:.1}", f64::from(v as f32))
            .replace('-', "\u{2212}")
            .replace("\u{2212}0.0", "0.0")
    };
    let wanted: Vec<String> = touches
        .iter()
        .map(|t| format!("{} {}", tenth(t.x_mm), tenth(t.y_mm)))
        .collect();
    assert_eq!(is, json!(wanted), "touches of frame {sequence}");
    sequence
}

#[test]
fn the_last_minutes_are_gone_back_through_and_live_goes_on() {
    let Some(browser) = browser() else { return };
    let (view, mut n) = (view(), 0);
    let mut page = browser.open(&view.url());
    until(&mut page, &view, &mut n, &format!("{SEQUENCE} >= 30"));
    page.press(" ");
    let held = shown(&mut page);
    // More comes, and is kept, but not shown.
    let more = "Number(document.querySelector('#time').max) - Number(document.querySelector('#time').value) > 12";
    until(&mut page, &view, &mut n, more);
    assert_eq!(shown(&mut page), held);
    // Without new frames it is drawn fainter, which begins at some time.
    let end = Instant::now() + NOT_FOR_EVER;
    while page.ask("document.querySelector('#connection-text').textContent.startsWith('no new')") != true {
        assert!(Instant::now() < end, "frames went on coming");
    }
    // The state is told before it is drawn.
    page.ask(DRAWN);
    let (at, seen) = (page.ask("document.querySelector('#time').value"), pixels(&mut page));
    page.press("ArrowLeft");
    let before = shown(&mut page);
    assert!(before < held, "{before} is before {held}");
    page.press("ArrowRight");
    assert_eq!(shown(&mut page), held);
    assert!(pixels(&mut page) == seen, "the same frame looks the same");
    page.press("ArrowRight");
    assert!(shown(&mut page) > held);
    page.press("Home");
    let first = shown(&mut page);
    assert!(first < before);
    // The slider goes anywhere.
    let go = |page: &mut Page, at: u64| {
        page.ask(&format!(
            "document.querySelector('#time').value = {at}; document.querySelector('#time').dispatchEvent(new Event('input'))"
        ));
        (shown(page), pixels(page))
    };
    // Whichever way one comes to it.
    let at = at.as_str().and_then(|at| at.parse().ok()).unwrap();
    for k in (at - 12..at).step_by(2) {
        let one = go(&mut page, k);
        page.press("Home");
        shown(&mut page);
        assert!(go(&mut page, k) == one, "the same frame looks the same");
    }
    assert!(go(&mut page, at) == (held, seen), "the same frame looks the same");
    assert_eq!(page.ask("document.querySelector('#connection-text').textContent === 'held' || document.querySelector('#connection-text').textContent.startsWith('no new')"), true);
    // Commands are for the sensor as it is now.
    assert_eq!(page.ask("document.querySelector('#tare').disabled"), false);
    page.press("End");
    until(&mut page, &view, &mut n, &format!("{SEQUENCE} > {held} + 30"));
    assert_eq!(page.ask("document.querySelector('#hold').ariaPressed"), "false");
    assert_eq!(page.ask("document.querySelector('#when').textContent"), "newest");
}

#[test]
fn what_is_kept_comes_back_as_it_was_and_is_bounded() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    let wrong = page.ask(
        r#"(async () => {
            const { History } = await import("/history.js");
            const most = 400_000;
            const history = new History(most);
            const scenes = [{ name: "a" }, { name: "b" }];
            const wrong = [];
            const truth = [];
            let seed = 1;
            const random = (n) => (seed = (seed * 48271) % 2147483647) % n;
            let steps = new Uint16Array(500);
            for (let k = 0; k < 1500; k++) {
                for (let c = random(30); c > 0; c--) steps[random(500)] = random(65536);
                // Twice as often as is kept; the clock begins anew once.
                const time = (k % 1000) / 60 + 1;
                history.add(k * 16, { time, number: k, touches: [], news: new Uint8Array(9) }, steps, scenes[k > 700 ? 1 : 0]);
                if (history.last === truth.length) truth.push([k, steps.slice()]);
                if (history.bytes > most) wrong.push(`${history.bytes} bytes`);
            }
            if (truth.length < 700 || truth.length > 800) wrong.push(`${truth.length} of 1500 kept`);
            if (history.first === 0 || history.last - history.first < 100) wrong.push(`${history.first} to ${history.last}`);
            for (let k = history.first; k <= history.last; k++) {
                const { frame, scene } = history.entry(k);
                const [number, cells] = truth[k];
                if (frame.number !== number || scene !== scenes[number > 700 ? 1 : 0]) wrong.push(`frame ${k}`);
                if (history.cells(k).join() !== cells.join()) wrong.push(`cells of ${k}`);
            }
            const old = history.entry(-5).k;
            if (old !== history.first) wrong.push(`the oldest is ${old}`);
            // A second is a second of the page's clock.
            const [from, to] = [history.last, history.step(history.last, -1)];
            const span = history.entry(from).now - history.entry(to).now;
            if (span < 960 || span > 1000) wrong.push(`a second of ${span} ms`);
            // Ten minutes later nothing of that is left but what comes then.
            for (let k = 0; k < 3; k++) history.add(700_000 + 40 * k, { time: 900 + k, number: k, touches: [] }, steps, {});
            if (history.last - history.first > 2) wrong.push("older than ten minutes");
            return wrong;
        })()"#,
    );
    assert_eq!(wrong, json!([]));
}

/// The saved image against a photograph of the page, in other colours and the other theme.
#[test]
fn what_is_saved_is_what_is_seen() {
    let Some(browser) = browser() else { return };
    let (view, mut n) = (view(), 0);
    let mut page = browser.open(&view.url());
    page.resize(1000, 640);
    page.ask(
        r#"HTMLAnchorElement.prototype.click = function () { globalThis.name = this.download; };
        const make = URL.createObjectURL;
        URL.createObjectURL = (blob) => { globalThis.saved = blob; return make.call(URL, blob); };"#,
    );
    for scheme in ["dark", "light"] {
        page.prefers(scheme);
        page.press("c");
        until(
            &mut page,
            &view,
            &mut n,
            &format!("theme.name === '{scheme}' && {SEQUENCE} >= 10"),
        );
        page.press("h");
        // Whatever comes or does not come now, it stays pale or not from here on.
        while page.ask("document.querySelector('#connection-text').textContent.startsWith('no new')") != true {
            std::thread::sleep(Duration::from_millis(100));
        }
        page.ask(DRAWN);
        let seen = page.seen();
        page.press("s");
        while page.ask("globalThis.saved === undefined") == true {
            std::thread::sleep(Duration::from_millis(20));
        }
        let differing = page.ask(&format!(
            r##"(async () => {{
                const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
                const stage = document.querySelector("#stage").getBoundingClientRect();
                const data = async (blob, x, y) => {{
                    const canvas = document.createElement("canvas");
                    [canvas.width, canvas.height] = [Math.floor(stage.width), Math.floor(stage.height)];
                    const c = canvas.getContext("2d");
                    c.drawImage(await createImageBitmap(blob), -x, -y);
                    return c.getImageData(0, 0, canvas.width, canvas.height).data;
                }};
                const photo = await data(new Blob([bytes("{seen}")], {{ type: "image/png" }}), stage.left, stage.top);
                const saved = await data(globalThis.saved, 0, 0);
                globalThis.saved = undefined;
                let differing = 0;
                for (let k = 0; k < photo.length; k += 4) {{
                    if ([0, 1, 2].some((c) => Math.abs(photo[k + c] - saved[k + c]) > 32)) differing++;
                }}
                return differing / (photo.length / 4);
            }})()"##
        ));
        // The edge of the sheet is not drawn with the same rounding.
        let differing = differing.as_f64().unwrap();
        assert!(differing < 0.01, "{scheme}: {differing} of the pixels");
        let file = format!("skin-{}.png", page.ask(SEQUENCE));
        assert_eq!(page.ask("globalThis.name"), file.as_str());
        page.press("h");
    }
}

#[test]
fn a_cell_is_drawn_in_one_colour_and_tells_its_value() {
    let Some(browser) = browser() else { return };
    let (view, mut n) = (view(), 0);
    let mut page = browser.open(&view.url());
    until(&mut page, &view, &mut n, &format!("{SEQUENCE} >= 10"));
    page.press("h");
    page.press("g");
    let sequence = shown(&mut page);
    // Every cell that lies whole inside the sheet has one colour.
    let colours = page.ask(
        r##"(() => {
            const canvas = document.querySelector("#field");
            const c = canvas.getContext("2d");
            const n = canvas.width / (39 + 1);
            let many = 0;
            for (let row = 14; row < 26; row++) for (let column = 14; column < 26; column++) {
                // The image begins at the middle of the cell beside the grid.
                const [x, y] = [Math.ceil((column + 0.5) * n), Math.ceil((row + 0.5) * n)];
                const pixels = new Uint32Array(c.getImageData(x, y, Math.floor(n) - 1, Math.floor(n) - 1).data.buffer);
                if (new Set(pixels).size !== 1) many++;
            }
            return [Number.isInteger(n), many];
        })()"##,
    );
    assert_eq!(colours, json!([true, 0]));
    let p = picture(&template(), sequence);
    for touch in &p.touches {
        let number = page.ask(&format!(
            r##"(() => {{
                const field = document.querySelector("#field").getBoundingClientRect();
                // 40 cells of 5 mm around the middle.
                const [x, y] = [field.left + field.width * ({x} + 100) / 200, field.top + field.height * (100 - {y}) / 200];
                document.querySelector("#stage").dispatchEvent(new PointerEvent("pointermove", {{ clientX: x, clientY: y }}));
                return document.querySelector("#probe").hidden ? "hidden" : document.querySelector("#probe").textContent;
            }})()"##,
            x = touch.x_mm,
            y = touch.y_mm
        ));
        let text = number.as_str().unwrap();
        let told: f64 = text
            .split(": ")
            .nth(1)
            .unwrap()
            .split('\u{202f}')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        let cell = p
            .grid
            .centres_mm()
            .position(|c| (c[0] - touch.x_mm).abs() <= 2.5 && (c[1] - touch.y_mm).abs() <= 2.5)
            .unwrap();
        let is = 100.0 * f64::from(p.values[cell]);
        assert!((told - is).abs() < 0.25, "{text}, but it is {is}");
    }
    page.press("g");
    assert_eq!(page.ask("document.querySelector('#probe').hidden"), true);
}

/// Of a replay the slider is the whole recording: the page asks for places, and shows where it is told to be.
#[test]
fn a_replay_is_gone_through_as_a_whole() {
    let Some(browser) = browser() else { return };
    let (view, mut n) = (view(), 0);
    let replay = |at_ms, paused| {
        view.set_replay(Replay {
            at_ms,
            length_ms: 221_000,
            paused,
        });
    };
    replay(12_340, false);
    let mut page = browser.open(&view.url());
    let says = "document.querySelector('#when').textContent + '; ' + document.querySelector('#hold-text').textContent + '; ' + document.querySelector('#connection-text').textContent";
    until(
        &mut page,
        &view,
        &mut n,
        &format!("({says}) === '0:12 of 3:41; Pause; replay'"),
    );
    let asked = |wanted: Command| {
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < NOT_FOR_EVER, "never: {wanted:?}");
            match view.command() {
                Some(it) => return assert_eq!(it, wanted),
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        }
    };
    page.press(" ");
    asked(Command::Pause);
    replay(12_400, true);
    until(
        &mut page,
        &view,
        &mut n,
        &format!("({says}) === '0:12 of 3:41; Play; paused'"),
    );
    page.shot("replay.png");
    page.press("h");
    asked(Command::Play);
    page.ask("document.querySelector('#time').value = 100000; document.querySelector('#time').dispatchEvent(new Event('input'))");
    asked(Command::Seek { at_ms: 100_000 });
    replay(100_000, true);
    until(
        &mut page,
        &view,
        &mut n,
        &format!("({says}) === '1:40 of 3:41; Play; paused'"),
    );
    // Of many in a moment the last is asked for, and the first where nothing was asked for just before.
    page.ask("for (const to of [1000, 2000, 3000]) { document.querySelector('#time').value = to; document.querySelector('#time').dispatchEvent(new Event('input')); }");
    let first = Command::Seek { at_ms: 1000 };
    let last = Command::Seek { at_ms: 3000 };
    let start = Instant::now();
    let next = || loop {
        assert!(start.elapsed() < NOT_FOR_EVER, "never: {last:?}");
        match view.command() {
            Some(it) => return it,
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    let asked_for = next();
    assert!(
        asked_for == last || (asked_for == first && next() == last),
        "{asked_for:?}"
    );
    page.press("End");
    asked(Command::Seek { at_ms: 221_000 });
    page.press("Home");
    asked(Command::Seek { at_ms: 0 });
    assert_eq!(view.command(), None);
    // What concerns a board has no place there; and who may not command may only watch.
    assert_eq!(page.ask("document.querySelector('#tare').disabled"), true);
    let mut other = browser.open(view.url().split_once('#').unwrap().0);
    until(
        &mut other,
        &view,
        &mut n,
        "document.querySelector('#time').disabled && document.querySelector('#hold').disabled",
    );
}

/// What the panel says of more touches, or fewer, leaves the curves less room, or more: their letters are never stretched.
#[test]
fn curves_are_drawn_for_the_room_that_they_have() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    page.resize(1280, 720);
    until(
        &mut page,
        &view,
        &mut 0,
        "document.querySelector('#touches').rows.length > 0",
    );
    // After every time that the page is painted.
    page.ask(
        r##"(() => {
        window.stretched = [];
        const trace = document.querySelector("#trace");
        const look = () => {
            const [is, fits] = [trace.height, Math.round(trace.clientHeight * devicePixelRatio)];
            if (is !== fits) stretched.push([is, fits]);
        };
        const again = () => { setTimeout(look, 0); requestAnimationFrame(again); };
        again();
    })()"##,
    );
    let (template, start) = (template(), Instant::now());
    let mut heights = Vec::new();
    // The list has six rows at most, and then a line of how many more there are.
    for (count, rows) in [(1, 1), (8, 6), (1, 1), (8, 6)] {
        let rows = format!("document.querySelector('#touches').rows.length === {rows}");
        while page.ask(&rows) != true {
            let mut picture = picture(&template, 30);
            let touch = picture.touches[0];
            picture.touches = vec![touch; count];
            view.publish(picture).unwrap();
            assert!(start.elapsed() < NOT_FOR_EVER, "never: {rows}");
            std::thread::sleep(Duration::from_millis(30));
        }
        heights.push(page.ask("document.querySelector('#trace').clientHeight"));
    }
    assert_ne!(heights[0], heights[1]);
    assert_eq!(page.ask("stretched"), json!([]));
}
