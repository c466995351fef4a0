//! A page that is shown live, over its WebSocket.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use serde::Serialize;
use tokio::sync::watch;

use crate::web::app::{App, ended};
use crate::web::guide::{self, Guide};
use crate::web::recording::{Recording, Told};
use crate::web::refused::Refused;
use crate::web::replay;
use crate::web::{Command, Published, Shared};
use crate::wire::{Clock, Request, Rights, Scene};

/// Pictures a page may have been sent without having taken them.
const CREDITS: usize = 2;

/// Most messages of a page within a second, beside its acknowledgements: some ten times what a page can need.
const MOST_MESSAGES: u32 = 50;

/// A page that takes nothing for so long is gone.
const STUCK: Duration = Duration::from_secs(10);

/// Serves one page until it leaves or the server stops.
pub(super) async fn show(socket: WebSocket, app: App) {
    let _present = Present::new(&app.shared);
    let watcher = Watcher {
        socket,
        shared: &app.shared,
        credits: CREDITS,
        messages: 0,
        since: Instant::now(),
        commands: false,
    };
    if let Err(error) = watcher.attend(app.stopped).await {
        tracing::debug!("a page has gone: {error}");
    }
    // The connection's place is free from here on.
    drop(app.place);
}

/// Counts a connected page as long as it lives.
struct Present(Arc<Shared>);

impl Present {
    fn new(shared: &Arc<Shared>) -> Self {
        shared.clients.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(shared))
    }
}

impl Drop for Present {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

struct Watcher<'a> {
    socket: WebSocket,
    shared: &'a Arc<Shared>,
    credits: usize,
    /// Messages since then, beside acknowledgements.
    messages: u32,
    since: Instant,
    /// Whether it has shown the token.
    commands: bool,
}

impl Watcher<'_> {
    async fn attend(mut self, stopped: watch::Receiver<bool>) -> Result<(), axum::Error> {
        let mut stop = std::pin::pin!(ended(stopped));
        let mut latest = self.shared.latest.subscribe();
        // The picture that is there already is news to this page.
        latest.mark_changed();
        let mut recording = self.shared.recording.subscribe();
        if *recording.borrow() != Recording::default() {
            recording.mark_changed();
        }
        let mut guide = self.shared.guide.subscribe();
        if *guide.borrow() != Guide::default() {
            guide.mark_changed();
        }
        let mut replay = self.shared.replay.subscribe();
        if replay.borrow().is_some() {
            replay.mark_changed();
        }
        let (mut scene, mut number) = (0, 0);
        loop {
            tokio::select! {
                biased;
                () = &mut stop => return self.send(Message::Close(None)).await,
                message = self.socket.recv() => {
                    let message = message.transpose()?;
                    if matches!(message, None | Some(Message::Close(_))) {
                        return Ok(());
                    }
                    if !self.is_decent(message.as_ref()) {
                        self.shared.refused.count(Refused::Flood);
                        let reason = "more messages than a page has to send".into();
                        return self.send(Message::Close(Some(CloseFrame { code: close_code::POLICY, reason }))).await;
                    }
                    match message {
                        Some(Message::Binary(_)) => self.credits += 1,
                        Some(Message::Text(text)) => self.answer(&text).await?,
                        _ => {}
                    }
                }
                changed = recording.changed() => {
                    if changed.is_err() {
                        return Ok(());
                    }
                    let now = recording.borrow_and_update().clone();
                    self.tell(&Told::from(&now)).await?;
                }
                changed = guide.changed() => {
                    if changed.is_err() {
                        return Ok(());
                    }
                    let now = guide.borrow_and_update().clone();
                    self.tell(&guide::Told::from(&now)).await?;
                }
                changed = replay.changed() => {
                    if changed.is_err() {
                        return Ok(());
                    }
                    let now = *replay.borrow_and_update();
                    if let Some(now) = now {
                        self.tell(&replay::Told::from(now)).await?;
                    }
                }
                changed = latest.changed(), if self.credits > 0 => {
                    if changed.is_err() {
                        return Ok(());
                    }
                    let Some((text, frame)) = news(&mut latest, self.shared, &mut scene, &mut number) else {
                        continue;
                    };
                    if let Some(text) = text {
                        self.send(Message::Text(text.into())).await?;
                    }
                    self.send(Message::Binary(frame)).await?;
                    self.credits -= 1;
                }
            }
        }
    }

    /// Whether this message is one that a page may send now. Nothing is acknowledged that was not sent.
    fn is_decent(&mut self, message: Option<&Message>) -> bool {
        if matches!(message, Some(Message::Binary(_))) {
            return self.credits < CREDITS;
        }
        if self.since.elapsed() > Duration::from_secs(1) {
            (self.since, self.messages) = (Instant::now(), 0);
        }
        self.messages += 1;
        self.messages <= MOST_MESSAGES
    }

    async fn send(&mut self, message: Message) -> Result<(), axum::Error> {
        let sent = tokio::time::timeout(STUCK, self.socket.send(message)).await;
        sent.unwrap_or_else(|stuck| Err(axum::Error::new(stuck)))
    }

    async fn tell(&mut self, answer: &impl Serialize) -> Result<(), axum::Error> {
        let text = serde_json::to_string(answer).unwrap_or_default();
        self.send(Message::Text(text.into())).await
    }

    async fn answer(&mut self, text: &str) -> Result<(), axum::Error> {
        let shared = self.shared;
        match serde_json::from_str(text) {
            Ok(Request::Enter { key }) => {
                let token = shared.keys.token_for(&key);
                self.commands = token.is_some();
                self.tell(&Rights { kind: "rights", token }).await
            }
            Ok(Request::Tare) => self.command(Command::Tare).await,
            Ok(Request::UndoBaseline) => self.command(Command::UndoBaseline).await,
            Ok(Request::StartRecording) => self.command(Command::StartRecording).await,
            Ok(Request::StopRecording) => self.command(Command::StopRecording).await,
            Ok(Request::RepeatPress) => self.command(Command::RepeatPress).await,
            Ok(Request::SkipPress) => self.command(Command::SkipPress).await,
            Ok(Request::Seek { at_ms }) => self.command(Command::Seek { at_ms }).await,
            Ok(Request::Pause) => self.command(Command::Pause).await,
            Ok(Request::Play) => self.command(Command::Play).await,
            Ok(Request::Clock { page_ms }) => {
                let server_ms = shared.now_ms();
                self.tell(&Clock {
                    kind: "clock",
                    page_ms,
                    server_ms,
                })
                .await
            }
            Err(error) => {
                tracing::debug!("a page asked for something unknown: {error}");
                Ok(())
            }
        }
    }

    /// Hands a command to the program, if this page may command and there is room.
    async fn command(&mut self, command: Command) -> Result<(), axum::Error> {
        if !self.commands {
            self.shared.refused.count(Refused::Command);
            return self
                .tell(&Rights {
                    kind: "rights",
                    token: None,
                })
                .await;
        }
        if self.shared.commands.try_send(command).is_err() {
            self.shared.refused.count(Refused::Excess);
        }
        Ok(())
    }
}

/// What to send to a page that has seen picture `number` of `scene`: the scene if it is another, and the frame.
fn news(
    latest: &mut watch::Receiver<Option<Published>>,
    shared: &Shared,
    scene: &mut u32,
    number: &mut u64,
) -> Option<(Option<String>, Bytes)> {
    let newest = latest.borrow_and_update();
    let published = newest.as_ref()?;
    let text = (*scene != published.scene).then(|| {
        (*scene, *number) = (published.scene, 0);
        scene_text(published, shared)
    });
    let frame = published.frame(*number, &shared.encoded);
    *number = published.shown.number();
    Some((text, frame))
}

fn scene_text(published: &Published, shared: &Shared) -> String {
    let scene = Scene::of(&published.picture, published.scene, shared.floor);
    serde_json::to_string(&scene).unwrap_or_default()
}
