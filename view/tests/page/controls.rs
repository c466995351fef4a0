//! The page's controls, pressed as a person does, and its layout at the sizes of screens.

use super::browser::Page;
use super::*;

/// Publishes until an expression of the page is what is wanted.
fn until(page: &mut Page, view: &LiveView, sequence: &mut u64, expression: &str, wanted: &str) {
    let end = Instant::now() + NOT_FOR_EVER;
    loop {
        *sequence += 1;
        view.publish(picture(&template(), *sequence)).unwrap();
        let is = page.ask(&format!("String({expression})"));
        if is == wanted {
            return;
        }
        assert!(Instant::now() < end, "{expression} is {is}, not {wanted}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

const LIVE: &str = "document.querySelector('#connection-text').textContent";
const BASELINE: &str = "document.querySelector('#tare').firstChild.textContent";

#[test]
fn the_whole_screen_is_taken_and_given_back_by_a_key() {
    let Some(browser) = browser() else { return };
    let (view, mut n) = (view(), 0);
    let mut page = browser.open(&view.url());
    until(&mut page, &view, &mut n, LIVE, "live");
    page.press("f");
    until(&mut page, &view, &mut n, "document.fullscreenElement !== null", "true");
    page.press("f");
    until(&mut page, &view, &mut n, "document.fullscreenElement !== null", "false");
}

#[test]
fn a_baseline_under_touches_is_asked_for_twice() {
    let Some(browser) = browser() else { return };
    let (view, mut n) = (view(), 0);
    let mut page = browser.open(&view.url());
    until(&mut page, &view, &mut n, LIVE, "live");
    until(
        &mut page,
        &view,
        &mut n,
        "document.querySelector('#tare').disabled",
        "false",
    );
    page.press("b");
    assert!(page.ask(BASELINE).as_str().unwrap().starts_with("Touched now"));
    assert!(view.command().is_none());
    // Not answered, it is the button that it was.
    until(&mut page, &view, &mut n, BASELINE, "Take baseline");
    assert!(view.command().is_none());
    page.ask("document.querySelector('#tare').click(); document.querySelector('#tare').click()");
    let end = Instant::now() + NOT_FOR_EVER;
    while view.command().is_none() {
        assert!(Instant::now() < end, "the command arrives");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn labels_keep_off_electrodes_scale_and_each_other_at_every_size() {
    let Some(browser) = browser() else { return };
    let view = view();
    let mut page = browser.open(&view.url());
    // Four fingers as in the scene of that name; every label's rectangle against all that is drawn around it.
    let covered = r##"(async () => {
        const { Sheet } = await import("/sheet.js");
        const at = (radius, n, k) => [radius * Math.cos((2 * Math.PI * k) / n), radius * Math.sin((2 * Math.PI * k) / n)];
        const outline_mm = Array.from({ length: 120 }, (_, k) => at(97.5, 120, k));
        const electrodes_mm = Array.from({ length: 16 }, (_, k) => at(97.5, 16, k));
        const canvas = () => document.createElement("canvas");
        const marks = document.createElement("div");
        const sheet = new Sheet(canvas(), canvas(), marks);
        const scene = { columns: 1, rows: 1, cells: [0], left_mm: 0, bottom_mm: 0, cell_mm: 5, outline_mm, electrodes_mm, faulty: [], uncalibrated: true };
        sheet.setScene(scene);
        const touches = [[-42, 42], [42, 42], [42, -42], [-42, -42]].map(([x, y], k) => ({ id: k + 1, x, y, area: 300, rise: 0.33, force: 25 }));
        const { clientWidth: w, clientHeight: h } = document.querySelector("#stage");
        sheet.layout(w, h);
        const rings = sheet.rings(canvas().getContext("2d"), touches);
        const places = sheet.labels.place(rings, sheet.bounds, sheet.keepOff);
        const meet = (a, b) => a.x < b.x + b.w && b.x < a.x + a.w && a.y < b.y + b.h && b.y < a.y + a.h;
        const wrong = [];
        places.forEach((place, k) => {
            sheet.keepOff.forEach((mark, m) => meet(place, mark) && wrong.push(`${k + 1} on mark ${m + 1}`));
            places.slice(k + 1).forEach((other, m) => meet(place, other) && wrong.push(`${k + 1} on label ${k + m + 2}`));
            if (place.x < 0 || place.y < 0 || place.x + place.w > w || place.y + place.h > h) wrong.push(`${k + 1} beyond the edge`);
        });
        if (document.documentElement.scrollWidth > innerWidth) wrong.push("the page is too wide");
        return wrong.join();
    })()"##;
    for (w, h) in [(1920, 1080), (1280, 720), (844, 390), (390, 844), (2560, 1440)] {
        page.resize(w, h);
        assert_eq!(page.ask(covered), "", "{w} x {h}");
    }
}
