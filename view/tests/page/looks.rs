//! What the page looks like: themes and their contrast, the help.

use super::{NOT_FOR_EVER, browser, picture, pixels, template, view};
use crate::browser::Page;
use serde_json::json;
use std::time::{Duration, Instant};
use view::web::{Command, LiveOptions, LiveView, Recording};

/// Publishes pictures until an expression is true.
fn until(view: &LiveView, page: &mut Page, what: &str) {
    let (template, start) = (template(), Instant::now());
    while page.ask(what) != true {
        view.publish(picture(&template, 30)).unwrap();
        assert!(start.elapsed() < NOT_FOR_EVER, "never: {what}");
        std::thread::sleep(Duration::from_millis(30));
    }
}

const SHOWN: &str = "document.querySelector('#connection-text').textContent === 'live' && document.querySelector('#touches').rows.length === 2";

/// Every text of the page, and every colour of the canvases, that stands out too little from what is behind it: WCAG 2.2, 1.4.3 and
/// 1.4.11.
const FAINT: &str = r##"(() => {
    const rgba = (css) => {
        const [r, g, b, a = 1] = css.match(/[\d.]+/g).map(Number);
        return [r, g, b, a];
    };
    const over = (top, under) => [0, 1, 2].map((k) => top[3] * top[k] + (1 - top[3]) * under[k]).concat(1);
    const light = (c) => {
        const [r, g, b] = c.slice(0, 3).map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const contrast = (a, b) => {
        const [high, low] = [light(a), light(b)].sort((x, y) => y - x);
        return (high + 0.05) / (low + 0.05);
    };
    const behind = (element) => {
        const layers = [];
        for (let e = element; e; e = e.parentElement) layers.push(rgba(getComputedStyle(e).backgroundColor));
        return layers.reverse().reduce((under, top) => over(top, under), [255, 255, 255, 1]);
    };
    const faint = [];
    for (const element of document.body.querySelectorAll("*")) {
        const text = [...element.childNodes].filter((n) => n.nodeType === 3).map((n) => n.data.trim()).join("");
        if (!text || !element.checkVisibility({ visibilityProperty: true }) || element.closest(":disabled, noscript")) continue;
        const [under, style] = [behind(element), getComputedStyle(element)];
        const colour = rgba(style.color);
        colour[3] *= Number(style.opacity);
        const value = contrast(over(colour, under), under);
        if (value < 4.5) faint.push(`${element.tagName} ${text}: ${value.toFixed(2)}`);
    }
    const probe = document.body.appendChild(document.createElement("i"));
    const named = (name) => {
        probe.style.color = theme.colour(name);
        return rgba(getComputedStyle(probe).color);
    };
    const numbers = Array.from({ length: 8 }, (_, k) => `id-${k + 1}`);
    const pairs = [
        ...["faint", "text", "broken", ...numbers].flatMap((name) => [[name, "back", 4.5], [name, "panel", 4.5]]),
        ...numbers.map((name) => ["on-id", name, 4.5]),
        ["text", "label", 4.5],
        ...["metal", "edge"].map((name) => [name, "back", 3]),
    ];
    for (const [name, ground, least] of pairs) {
        const under = over(named(ground), named("back"));
        const value = contrast(over(named(name), under), under);
        if (!(value >= least)) faint.push(`${name} on ${ground}: ${value.toFixed(2)}`);
    }
    probe.remove();
    return faint;
})()"##;

#[test]
fn a_theme_is_the_systems_until_one_is_chosen_and_all_can_be_read() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    page.resize(1280, 720);
    let mut seen = Vec::new();
    for scheme in ["dark", "light"] {
        page.prefers(scheme);
        until(&view, &mut page, &format!("theme.name === '{scheme}' && {SHOWN}"));
        page.ask("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))");
        seen.push(pixels(&mut page));
        page.shot(&format!("{scheme}.png"));
        page.ask("document.querySelector('#help').showModal()");
        assert_eq!(page.ask(FAINT), json!([]), "{scheme}");
        page.shot(&format!("help-{scheme}.png"));
        page.ask("document.querySelector('#help').close()");
    }
    assert_ne!(seen[0], seen[1], "what is drawn follows the theme");
    // Chosen by the key against the system, it is remembered; back at the system's it is not.
    page.press("t");
    let state = "[theme.name, localStorage.getItem('theme')].join()";
    assert_eq!(page.ask(state), "dark,dark");
    let mut other = browser.open(&view.url());
    other.prefers("light");
    until(&view, &mut other, "matchMedia('(prefers-color-scheme: light)').matches");
    assert_eq!(other.ask(state), "dark,dark");
    other.ask("document.querySelector('#theme').click()");
    assert_eq!(other.ask(state), "light,");
    other.prefers("dark");
    until(&view, &mut other, &format!("{state} === 'dark,'"));
}

#[test]
fn the_help_opens_and_closes_by_the_keyboard_and_tells_every_key() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    until(&view, &mut page, SHOWN);
    let open = "document.querySelector('#help').open";
    let inside = "document.querySelector('#help').contains(document.activeElement)";
    page.press("?");
    assert_eq!(page.ask(open), true);
    assert_eq!(page.ask(inside), true);
    // Nothing behind it is reached meanwhile, by Tab or by its key.
    for _ in 0..3 {
        page.press("Tab");
        assert_eq!(
            page.ask(&format!("{inside} || document.activeElement === document.body")),
            true
        );
    }
    page.press("h");
    assert_eq!(page.ask("document.querySelector('#hold').ariaPressed"), "false");
    page.press("Escape");
    assert_eq!(page.ask(open), false);
    // From the button and back to it.
    page.ask("document.querySelector('#help-open').focus()");
    page.press("Enter");
    assert_eq!(page.ask(open), true);
    page.press("Enter");
    assert_eq!(page.ask(open), false);
    assert_eq!(page.ask("document.activeElement.id"), "help-open");
    let untold = page.ask(
        r##"(() => {
            const keys = [...document.querySelectorAll("[aria-keyshortcuts]")].map((e) => e.ariaKeyShortcuts ?? e.getAttribute("aria-keyshortcuts"));
            const told = [...document.querySelectorAll("#help kbd")].map((kbd) => kbd.textContent.toLowerCase());
            return keys.concat("c", "esc").filter((key) => !told.includes(key.toLowerCase()));
        })()"##,
    );
    assert_eq!(untold, json!([]));
}

/// Texts that canvases draw, where they are drawn: [canvas, text, left, top, right, bottom] in CSS pixels of the canvas.
const LISTEN: &str = r##"(() => {
    globalThis.texts = [];
    const draw = CanvasRenderingContext2D.prototype.fillText;
    CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
        const m = this.measureText(text);
        const t = this.getTransform();
        const dpr = devicePixelRatio;
        const [ax, ay] = [(t.a * x + t.e) / dpr, (t.d * y + t.f) / dpr];
        texts.push([
            this.canvas.id, String(text), ax - m.actualBoundingBoxLeft, ay - m.actualBoundingBoxAscent,
            ax + m.actualBoundingBoxRight, ay + m.actualBoundingBoxDescent,
        ]);
        return draw.call(this, text, x, y);
    };
})()"##;

/// What lies on something else or is cut off: texts of canvases, parts of the page. Texts of the touches lie on the sheet, and on
/// nothing else that is written.
const CROWDED: &str = r##"(async () => {
    const frames = (n) => new Promise((done) => { const next = () => (n-- ? requestAnimationFrame(next) : done()); next(); });
    await frames(3);
    // Everything is drawn once more.
    theme.toggle();
    await frames(4);
    texts.length = 0;
    theme.toggle();
    await frames(4);
    const wrong = [];
    const meets = (a, b, least = 1) =>
        Math.min(a[2], b[2]) - Math.max(a[0], b[0]) > least && Math.min(a[3], b[3]) - Math.max(a[1], b[1]) > least;
    for (const id of ["frame", "trace"]) {
        const canvas = document.getElementById(id);
        const all = new Map(texts.filter(([of]) => of === id).map(([, text, ...box]) => [[text, ...box.map(Math.round)].join(), [text, box]]));
        const list = [...all.values()];
        if (list.length < 3) wrong.push(`${id} draws only ${list.length} texts`);
        list.forEach(([text, box], k) => {
            if (box[0] < 0 || box[1] < 0 || box[2] > canvas.clientWidth || box[3] > canvas.clientHeight) wrong.push(`${id}: ${text} is cut off: ${box}`);
            // Curves' numbers move with them.
            if (id === "frame") list.slice(k + 1).forEach(([other, its]) => meets(box, its) && wrong.push(`${id}: ${text} on ${other}`));
        });
    }
    const box = (e) => { const r = e.getBoundingClientRect(); return [r.left, r.top, r.right, r.bottom]; };
    const parts = [...document.querySelectorAll("body > header > *, #stage, aside > section, .controls > *, .row > *, dl > div, tr > *, #banner")]
        .filter((e) => e.checkVisibility() && !e.closest("dialog"));
    parts.forEach((a, k) => {
        if (a.scrollWidth > a.clientWidth + 1 && getComputedStyle(a).overflowX === "visible" && a.clientWidth) wrong.push(`${a.id || a.tagName} ${a.textContent.trim()}: wider than its place`);
        parts.slice(k + 1).forEach((b) => {
            if (a.contains(b) || b.contains(a) || b.id === "banner" || a.closest("body > header") || b.closest("body > header")) return;
            if (meets(box(a), box(b))) wrong.push(`${a.id || a.tagName} ${a.textContent.trim().slice(0, 20)} on ${b.id || b.tagName} ${b.textContent.trim().slice(0, 20)}`);
        });
    });
    const head = [...document.querySelectorAll("body > header > *")].filter((e) => e.checkVisibility());
    head.forEach((a, k) => head.slice(k + 1).forEach((b) => meets(box(a), box(b)) && wrong.push(`${a.id} on ${b.id} in the header`)));
    if (document.documentElement.scrollWidth > innerWidth) wrong.push(`the page is ${document.documentElement.scrollWidth} wide`);
    return [...new Set(wrong)];
})()"##;

#[test]
fn nothing_overlaps_and_no_text_is_cut_off_on_any_screen() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    page.ask(LISTEN);
    until(&view, &mut page, SHOWN);
    for scheme in ["dark", "light"] {
        page.prefers(scheme);
        for (width, height) in [(1920, 1080), (1280, 720), (844, 390), (390, 844), (768, 1024)] {
            page.resize(width, height);
            assert_eq!(page.ask(CROWDED), json!([]), "{width}x{height} {scheme}");
            // For a look at it: as eyes that confuse red and green see it.
            page.seen_with("deuteranopia");
            page.shot(&format!("{scheme}-{width}x{height}.png"));
            page.seen_with("none");
        }
    }
}

#[test]
fn a_recording_is_asked_for_ended_and_shown() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    until(&view, &mut page, SHOWN);
    let start = Instant::now();
    let commanded = |command: Command| {
        loop {
            assert!(start.elapsed() < NOT_FOR_EVER, "never: {command:?}");
            match view.command() {
                Some(it) => return assert_eq!(it, command),
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        }
    };
    let says = |page: &mut Page, text: &str| {
        let what = r##"document.querySelector("#record-text").textContent + ": " + document.querySelector("#recording").textContent"##;
        until(&view, page, &format!("{what} === {}", json!(text)));
    };
    says(&mut page, "Record: ");
    page.press("r");
    commanded(Command::StartRecording);
    view.set_recording(Recording {
        file: Some("skin-20261123T154500Z-7.mcap".into()),
        bytes: 12_340_000,
        seconds: 754,
        note: None,
    });
    says(&mut page, "Stop: skin-20261123T154500Z-7.mcap: 12.3\u{a0}MB, 12:34");
    page.shot("recording.png");
    page.ask("document.querySelector('#record').click()");
    commanded(Command::StopRecording);
    let note = Some("not recorded: the disk is full".to_owned());
    view.set_recording(Recording {
        note,
        ..Recording::default()
    });
    says(&mut page, "Record: not recorded: the disk is full");
    // Who comes later is told, too; and may not ask without the token.
    let mut other = browser.open(view.url().split_once('#').unwrap().0);
    says(&mut other, "Record: not recorded: the disk is full");
    assert_eq!(other.ask("document.querySelector('#record').disabled"), true);
}

#[test]
fn a_program_that_prepares_says_so_and_not_that_nothing_touches() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    let start = Instant::now();
    let becomes = |page: &mut Page, pictures: Option<bool>, wanted: &str| {
        let says = r##"[...document.querySelectorAll("#connection-text, #banner, #count")].map((e) => e.textContent).join("; ")"##;
        while page.ask(says) != wanted {
            if let Some(preparing) = pictures {
                let mut picture = picture(&template(), 30);
                picture.stats.preparing = preparing;
                if preparing {
                    picture.touches.clear();
                    picture.stats.status = Some("taking the baseline, do not touch".into());
                }
                view.publish(picture).unwrap();
            }
            assert!(start.elapsed() < NOT_FOR_EVER, "{} is not {wanted}", page.ask(says));
            std::thread::sleep(Duration::from_millis(30));
        }
    };
    let none = "No picture yet: the program looks for the board, models the sheet and takes a baseline. Do not touch.";
    becomes(&mut page, None, &format!("preparing; {none}; preparing"));
    page.shot("before.png");
    becomes(
        &mut page,
        Some(true),
        "preparing; taking the baseline, do not touch; preparing",
    );
    page.shot("preparing.png");
    becomes(&mut page, Some(false), "live; ; 2 touches");
}

/// A long banner on a small screen leaves room for the electrodes' numbers.
#[test]
fn a_banner_covers_no_electrode() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    page.ask(LISTEN);
    page.resize(390, 844);
    let mut sequence = 30;
    let start = Instant::now();
    let lines = r##"((b) => b.textContent.startsWith("no touches") && b.offsetHeight > 60)(document.querySelector("#banner"))"##;
    while page.ask(lines) != true {
        sequence += 1;
        let mut picture = picture(&template(), sequence);
        picture.stats.status = Some("no touches of the expected size explain the change: shown is what explains most of it, of other objects or of contacts that changed since the baseline".into());
        view.publish(picture).unwrap();
        assert!(start.elapsed() < NOT_FOR_EVER, "the banner never has many lines");
        std::thread::sleep(Duration::from_millis(30));
    }
    assert_eq!(page.ask(CROWDED), json!([]));
    let covered = page.ask(
        r##"(() => {
            const { offsetTop: top, offsetHeight: height } = document.querySelector("#banner");
            return texts.filter(([id, , , least]) => id === "frame" && least < top + height).map(([, text]) => text);
        })()"##,
    );
    assert_eq!(covered, json!([]));
    page.shot("banner-390x844.png");
}

/// Every name can be read on every screen.
#[test]
fn the_names_of_skins_have_room() {
    let Some(browser) = browser() else { return };
    let names = [
        "palm",
        "chest",
        "forearm-left",
        "forearm-right",
        "back-of-the-left-hand",
        "shoulder",
    ];
    let options = LiveOptions {
        listen: "127.0.0.1:0".parse().unwrap(),
        ..LiveOptions::default()
    };
    let views = LiveView::start_named(options, &names).unwrap();
    let shown = &views[4];
    let mut page = browser.open(&shown.url().replace("/#", &format!("/{}/#", names[4])));
    page.ask(LISTEN);
    until(shown, &mut page, SHOWN);
    for (width, height) in [(1920, 1080), (1280, 720), (844, 390), (390, 844)] {
        page.resize(width, height);
        assert_eq!(page.ask(CROWDED), json!([]), "{width}x{height}");
        let wrong = page.ask(
            r##"(() => {
                const row = document.querySelector("#skins").getBoundingClientRect();
                return [...document.querySelectorAll("#skins a")].filter((link) => {
                    const own = link.getBoundingClientRect();
                    return own.left < row.left - 1 || own.right > row.right + 1 || row.right > innerWidth;
                }).map((link) => link.textContent);
            })()"##,
        );
        assert_eq!(wrong, json!([]), "{width}x{height}");
        page.shot(&format!("names-{width}x{height}.png"));
    }
}

/// A colour of style.css in Lab, as eyes without the cones for green see it or as all see it: Machado, Oliveira and Fernandes 2009,
/// severity 1.0.
fn lab(hex: &str, deuteranopia: bool) -> [f64; 3] {
    let channel = |k: usize| f64::from(u8::from_str_radix(&hex[1 + 2 * k..3 + 2 * k], 16).unwrap()) / 255.0;
    let linear = |v: f64| {
        if v <= 0.04045 {
            v / 12.92
        } else {
            ((v + 0.055) / 1.055).powf(2.4)
        }
    };
    let times = |m: [[f64; 3]; 3], v: [f64; 3]| m.map(|row| (0..3).map(|k| row[k] * v[k]).sum::<f64>());
    let mut rgb = [0, 1, 2].map(|k| linear(channel(k)));
    if deuteranopia {
        let seen = [
            [0.367_322, 0.860_646, -0.227_968],
            [0.280_085, 0.672_501, 0.047_413],
            [-0.011_820, 0.042_940, 0.968_881],
        ];
        rgb = times(seen, rgb).map(|v| v.clamp(0.0, 1.0));
    }
    let xyz = [
        [0.4124, 0.3576, 0.1805],
        [0.2126, 0.7152, 0.0722],
        [0.0193, 0.1192, 0.9505],
    ];
    let [x, y, z] = times(xyz, rgb);
    let f = |v: f64| {
        if v > 0.008_856 {
            v.cbrt()
        } else {
            7.787 * v + 16.0 / 116.0
        }
    };
    let [x, y, z] = [f(x / 0.9505), f(y), f(z / 1.089)];
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Colours of touches' numbers whose lines are drawn alike: four solid, four dashed. A difference of 2.3 is just noticed.
#[test]
fn lines_that_are_drawn_alike_are_told_apart_by_every_eye() {
    let style = include_str!("../../src/page/style.css");
    let colours: Vec<&str> = (1..=8)
        .flat_map(|id| {
            let name = format!("--id-{id}: ");
            let of_themes: Vec<&str> = style.split(&name).skip(1).map(|rest| &rest[..7]).collect();
            assert_eq!(of_themes.len(), 2, "{name}");
            of_themes
        })
        .collect();
    for theme in 0..2 {
        for first in [0, 4] {
            let four: Vec<&str> = (first..first + 4).map(|id| colours[2 * id + theme]).collect();
            for (k, a) in four.iter().enumerate() {
                for b in &four[k + 1..] {
                    for deuteranopia in [false, true] {
                        let (p, q) = (lab(a, deuteranopia), lab(b, deuteranopia));
                        let apart = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt();
                        assert!(
                            apart > 25.0,
                            "{a} and {b} are {apart:.0} apart, deuteranopia {deuteranopia}"
                        );
                    }
                }
            }
        }
    }
}

/// Seven touches of nearly the same rise: their numbers beside the curves can be read, and the fifth to the seventh are dashed.
#[test]
fn numbers_beside_the_curves_lie_on_nothing() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    // Room for all seven.
    page.resize(1280, 1080);
    page.ask(LISTEN);
    page.ask(
        r##"(() => {
            globalThis.dashed = new Set();
            const set = CanvasRenderingContext2D.prototype.setLineDash;
            CanvasRenderingContext2D.prototype.setLineDash = function (dash) {
                if (this.canvas.id === "trace" && dash.length) dashed.add(String(this.strokeStyle));
                return set.call(this, dash);
            };
        })()"##,
    );
    // The last place of every number, and what lies on what.
    let what = r##"(() => {
        const of_trace = texts.filter(([of, text]) => of === "trace" && /^[1-7]$/.test(text));
        const last = new Map(of_trace.map(([, text, ...box]) => [text, box]));
        texts.length = 0;
        if (last.size < 7) return "";
        const all = [...last];
        const meets = (a, b) => Math.min(a[2], b[2]) - Math.max(a[0], b[0]) > 0 && Math.min(a[3], b[3]) - Math.max(a[1], b[1]) > 0;
        const on = all.flatMap(([text, box], k) => all.slice(k + 1).filter(([, other]) => meets(box, other)).map(([other]) => `${text} on ${other}`));
        return on.concat(`${dashed.size} dashed`).join();
    })()"##;
    let (template, start) = (template(), Instant::now());
    for sequence in 1.. {
        let mut shown = picture(&template, sequence);
        shown.touches = (1..=7)
            .map(|id| inverse::touches::touch::Touch {
                id: Some(id),
                x_mm: 20.0 * f64::from(id) - 80.0,
                rise: 0.2 + 0.001 * f64::from(id),
                at_limit: id == 6,
                area_mm2: if id == 7 { 0.0 } else { 300.0 },
                ..Default::default()
            })
            .collect();
        view.publish(shown).unwrap();
        match page.ask(what).as_str() {
            Some("") => assert!(start.elapsed() < NOT_FOR_EVER, "the numbers are never drawn"),
            found => {
                assert_eq!(found, Some("3 dashed"));
                break;
            }
        }
        std::thread::sleep(Duration::from_millis(30));
    }
    page.shot("seven-curves.png");
    // An area that is not known is no area of 0.
    let areas = page.ask("[...document.querySelectorAll('#touches tr')].map((row) => [row.cells[0], row.cells[4]].map((c) => c.textContent).join()).join(';')");
    let areas = areas.as_str().unwrap();
    assert!(areas.contains("7,\u{2013}") && areas.contains("6,300"), "{areas}");
    // A rise at the model's limit is at least so large.
    let rises = page.ask("[...document.querySelectorAll('#touches tr')].filter((row) => row.cells[3]?.textContent.startsWith('\u{2265}')).map((row) => row.cells[0].textContent).join()");
    assert_eq!(rises, "6");
}

/// Lines that strokes of the touches' marks draw, [x, y] to [x, y] in CSS pixels of the sheet.
const LINES: &str = r##"(() => {
    globalThis.lines = [];
    const paths = new WeakMap();
    for (const name of ["moveTo", "lineTo"]) {
        const draw = Path2D.prototype[name];
        Path2D.prototype[name] = function (x, y) {
            paths.set(this, [...(paths.get(this) ?? []), [x, y]]);
            return draw.call(this, x, y);
        };
    }
    const stroke = CanvasRenderingContext2D.prototype.stroke;
    CanvasRenderingContext2D.prototype.stroke = function (path) {
        const points = path && paths.get(path);
        if (points?.length === 2 && this.canvas.parentElement?.id === "marks") lines.push(points);
        return path ? stroke.call(this, path) : stroke.call(this);
    };
})()"##;

/// Five fingers all round, turned so that there is little room for their labels on a small screen: what leads from a finger to its label runs over no electrode's number.
#[test]
fn lines_to_labels_keep_off_the_electrodes_numbers() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    page.ask(LISTEN);
    page.ask(LINES);
    until(&view, &mut page, SHOWN);
    let (template, start) = (template(), Instant::now());
    let (mut sequence, mut led) = (1000, 0);
    for (width, height) in [(1920, 1080), (1280, 800), (844, 390), (390, 844), (768, 1024)] {
        page.resize(width, height);
        page.ask("new Promise((laid) => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(laid))))");
        for turn in [15, 16, 22, 23] {
            // The rise tells whether this picture is drawn.
            let percent = turn;
            let finger = |id: u32| {
                let fingers = [
                    (60.0_f64, 20.0_f64),
                    (55.0, 95.0),
                    (62.0, 170.0),
                    (58.0, 245.0),
                    (50.0, 318.0),
                ];
                let (radius, degrees) = fingers[id as usize - 1];
                let angle = degrees.to_radians() + 0.05 * f64::from(turn);
                inverse::touches::touch::Touch {
                    id: Some(id),
                    x_mm: radius * angle.cos(),
                    y_mm: radius * angle.sin(),
                    rise: 0.01 * f64::from(percent),
                    area_mm2: 314.0,
                    ..Default::default()
                }
            };
            page.ask("(theme.toggle(), texts.length = lines.length = 0)");
            let drawn = format!(
                "texts.filter(([, text]) => text === '+{percent}\u{202f}%').length >= 5 && texts.filter(([of]) => of === 'frame').length > 16"
            );
            while page.ask(&drawn) != true {
                sequence += 1;
                let mut shown = picture(&template, sequence);
                shown.touches = (1..=5).map(finger).collect();
                view.publish(shown).unwrap();
                assert!(start.elapsed() < NOT_FOR_EVER, "never drawn: {width}x{height}, {turn}");
                std::thread::sleep(Duration::from_millis(30));
            }
            let found = page.ask(
                r##"(() => {
                    const numbers = texts.filter(([of, text]) => of === "frame" && /^\d+$/.test(text));
                    const runs = ([[x0, y0], [x1, y1]], [, , left, top, right, bottom]) => {
                        // Every half pixel of the way.
                        const steps = Math.ceil(2 * Math.hypot(x1 - x0, y1 - y0));
                        return Array.from({ length: steps + 1 }, (_, k) => k / Math.max(1, steps)).some((t) => {
                            const [x, y] = [x0 + t * (x1 - x0), y0 + t * (y1 - y0)];
                            return x > left && x < right && y > top && y < bottom;
                        });
                    };
                    const over = lines.flatMap((line) => numbers.filter((n) => runs(line, n)).map(([, text]) => text));
                    return [lines.length, [...new Set(over)], new Set(numbers.map(([, text]) => text)).size];
                })()"##,
            );
            led += found[0].as_u64().unwrap();
            if found[1] != json!([]) {
                page.shot(&format!("lines-{width}x{height}-{turn}.png"));
            }
            assert_eq!(
                (&found[1], &found[2]),
                (&json!([]), &json!(16)),
                "{width}x{height}, {turn}"
            );
        }
        page.shot(&format!("five-{width}x{height}.png"));
    }
    assert!(led > 0, "no line was drawn");
}
