//! A Chromium without a window, spoken to over its debugging protocol.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

pub(crate) struct Browser {
    child: Child,
    port: u16,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// None where there is none.
    pub(crate) fn start() -> Option<Self> {
        let profile = tempfile::tempdir().unwrap();
        let mut child = ["chromium", "chromium-browser", "google-chrome"]
            .iter()
            .find_map(|program| {
                Command::new(program)
                    .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"])
                    .args([
                        "--disable-background-networking",
                        "--disable-component-update",
                        "--disable-sync",
                    ])
                    .args(["--remote-debugging-port=0", "--window-size=1280,800"])
                    .arg(format!("--user-data-dir={}", profile.path().display()))
                    .arg("about:blank")
                    .stdin(Stdio::null())
                    .stdout(Stdio::null())
                    .stderr(Stdio::piped())
                    .spawn()
                    .ok()
            })?;
        let mut lines = BufReader::new(child.stderr.take()?).lines();
        let port = lines.by_ref().map_while(Result::ok).find_map(|line| {
            let (_, address) = line.split_once("DevTools listening on ws://127.0.0.1:")?;
            address.split('/').next()?.parse().ok()
        });
        // Whatever else it says must not fill the pipe.
        std::thread::spawn(move || lines.map_while(Result::ok).for_each(drop));
        Some(Self {
            port: port.expect("the browser starts"),
            child,
            _profile: profile,
        })
    }

    pub(crate) fn open(&self, url: &str) -> Page {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        write!(
            stream,
            "PUT /json/new?{url} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nConnection: close\r\n\r\n",
            self.port
        )
        .unwrap();
        // It does not always close the connection; the answer's length is in its head.
        let mut answer = Vec::new();
        let body = loop {
            let mut bytes = [0; 4096];
            let count = stream.read(&mut bytes).unwrap();
            assert!(count > 0, "the browser opens a page");
            answer.extend(&bytes[..count]);
            let text = String::from_utf8_lossy(&answer);
            if let Some((head, body)) = text.split_once("\r\n\r\n") {
                let length = head
                    .lines()
                    .find_map(|l| l.to_lowercase().strip_prefix("content-length:")?.trim().parse().ok());
                if length.is_some_and(|n: usize| body.len() >= n) {
                    break body.to_owned();
                }
            }
        };
        let target: Value = serde_json::from_str(&body).unwrap();
        let address = target["webSocketDebuggerUrl"].as_str().unwrap();
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let mut page = Page {
            socket: tungstenite::client(address, stream).unwrap().0,
            asked: 0,
            frames: 0,
            bytes: 0,
        };
        page.call("Network.enable", json!({}));
        while page.ask("location.href !== 'about:blank' && document.readyState === 'complete'") != true {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        page
    }

    /// Time that all its processes were on a processor, s.
    pub(crate) fn processor_s(&self) -> f64 {
        let stats: Vec<(u32, u32, u64)> = std::fs::read_dir("/proc")
            .unwrap()
            .filter_map(|entry| {
                let stat = std::fs::read_to_string(entry.ok()?.path().join("stat")).ok()?;
                let id = stat.split(' ').next()?.parse().ok()?;
                let rest: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
                let ticks = rest[11].parse::<u64>().ok()? + rest[12].parse::<u64>().ok()?;
                Some((id, rest[1].parse().ok()?, ticks))
            })
            .collect();
        let mut family = vec![self.child.id()];
        let mut ticks = 0;
        while let Some(id) = family.pop() {
            ticks += stats.iter().filter(|s| s.0 == id).map(|s| s.2).sum::<u64>();
            family.extend(stats.iter().filter(|s| s.1 == id).map(|s| s.0));
        }
        ticks as f64 / 100.0
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub(crate) struct Page {
    socket: WebSocket<TcpStream>,
    asked: u64,
    /// Binary messages that it has received over its own WebSocket, and their bytes.
    pub(crate) frames: u64,
    pub(crate) bytes: u64,
}

impl Page {
    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.asked += 1;
        let request = json!({ "id": self.asked, "method": method, "params": parameters });
        self.socket.send(Message::Text(request.to_string().into())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else {
                continue;
            };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["method"] == "Network.webSocketFrameReceived" && answer["params"]["response"]["opcode"] == 2 {
                // In base 64.
                let data = answer["params"]["response"]["payloadData"].as_str().unwrap();
                self.frames += 1;
                self.bytes += (data.trim_end_matches('=').len() * 3 / 4) as u64;
            }
            if answer["id"] == self.asked {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// What an expression is, when its promise is kept.
    pub(crate) fn ask(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let answer = self.call("Runtime.evaluate", parameters);
        assert!(answer.get("exceptionDetails").is_none(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// The system prefers these colours from now on, "light" or "dark".
    pub(crate) fn prefers(&mut self, scheme: &str) {
        let feature = json!({ "name": "prefers-color-scheme", "value": scheme });
        self.call("Emulation.setEmulatedMedia", json!({ "features": [feature] }));
    }

    /// The page is seen by eyes with this deficiency from now on, "none" or "deuteranopia".
    pub(crate) fn seen_with(&mut self, deficiency: &str) {
        self.call("Emulation.setEmulatedVisionDeficiency", json!({ "type": deficiency }));
    }

    /// What the page looks like, a PNG in base 64.
    pub(crate) fn seen(&mut self) -> String {
        let answer = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        answer["data"].as_str().unwrap().to_owned()
    }

    /// The window has this size from now on, CSS pixels.
    pub(crate) fn resize(&mut self, width: u32, height: u32) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// Presses and releases a key, as a keyboard does.
    pub(crate) fn press(&mut self, key: &str) {
        let code = match key {
            "Escape" => 27,
            "Tab" => 9,
            "Enter" => 13,
            _ => 0,
        };
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({ "type": kind, "key": key, "code": key, "windowsVirtualKeyCode": code });
            if kind == "keyDown" && key.len() == 1 {
                event["text"] = key.into();
            }
            if kind == "keyDown" && key == "Enter" {
                event["text"] = "\r".into();
            }
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Keeps what the page looks like as a PNG file in the folder that `SKIN_SHOTS` names, where it names one.
    pub(crate) fn shot(&mut self, name: &str) {
        let Some(folder) = std::env::var_os("SKIN_SHOTS") else {
            return;
        };
        let png = from_base64(&self.seen());
        std::fs::write(std::path::Path::new(&folder).join(name), png).unwrap();
    }

    /// Time that the page's main thread worked, s; and of this in scripts.
    pub(crate) fn worked_s(&mut self) -> [f64; 2] {
        self.call("Performance.enable", json!({}));
        let metrics = self.call("Performance.getMetrics", json!({}));
        ["TaskDuration", "ScriptDuration"].map(|name| {
            let list = metrics["metrics"].as_array().unwrap();
            list.iter().find(|m| m["name"] == name).unwrap()["value"]
                .as_f64()
                .unwrap()
        })
    }
}

fn from_base64(text: &str) -> Vec<u8> {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let (mut out, mut bits, mut held) = (Vec::new(), 0_u32, 0);
    for digit in text.bytes().filter_map(|b| digits.iter().position(|d| *d == b)) {
        bits = bits << 6 | digit as u32;
        held += 6;
        if held >= 8 {
            held -= 8;
            out.push((bits >> held) as u8);
        }
    }
    out
}
