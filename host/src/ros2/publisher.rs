//! The nodes of this program, and the thread that sends what they have.

use super::endpoints::{Delivery, Endpoints, Reader, Writer};
use super::environment::Network;
use super::facts::Sent;
use super::mailbox::{Mailbox, Node, Sample};
use super::messages::{self, Header, Pose, unix_ns};
use super::replies::Replies;
use super::tare::Request;
use super::{Described, SKIN};
use crate::files::baseline_file::unix_s;
use crate::files::cdr::Cdr;
use crate::say::say;
use anyhow::{Context, Result, bail};
use rustdds::{
    DomainParticipantBuilder, DomainParticipantStatusEvent, DomainParticipantStatusListener, GUID, RTPSEntity,
    StatusEvented,
};
use std::collections::{HashMap, HashSet};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// Requests and whoever comes or goes are looked for so often.
const LOOK: Duration = Duration::from_millis(50);
/// How skins are is told so often.
const DIAGNOSTICS: Duration = Duration::from_secs(1);
/// At the end the last messages have so long to arrive.
const LAST: Duration = Duration::from_millis(500);

/// The skins of this program as nodes of ROS 2.
pub(crate) struct Ros2 {
    mailbox: Arc<Mailbox>,
    /// Empty, or such as `/robot1`.
    namespace: String,
    endpoints: Endpoints,
    names: Mutex<Vec<String>>,
    new: Sender<Ends>,
    thread: Option<JoinHandle<()>>,
}

/// The endpoints of a skin.
struct Ends {
    slot: usize,
    name: String,
    serial: String,
    sheet_frame: String,
    /// The frame of the robot that the sheet is placed in, or its own.
    link: String,
    pose: Pose,
    touches: Writer,
    image: Writer,
    points: Writer,
    diagnostics: Writer,
    requests: Reader,
    replies: Replies,
    sent: Sent,
    told: Sent,
}

impl Ros2 {
    /// Joins the network that the environment names.
    ///
    /// # Errors
    /// A namespace or an environment that cannot be, or no network.
    pub(crate) fn start(namespace: Option<&str>) -> Result<Self> {
        let namespace = namespace.map(self::namespace).transpose()?.unwrap_or_default();
        let network = Network::of(|name| std::env::var(name).ok())?;
        // Little comes in, and much less than a socket's usual memory goes out at once.
        let mut builder = DomainParticipantBuilder::new(network.domain)
            .socket_receive_buffer_size(1 << 17)
            .socket_send_buffer_size(0);
        if let Some(only) = network.only() {
            builder = builder.with_only_networks(only);
        }
        let participant = builder.build().context("ROS 2: DDS cannot be started")?;
        say!(
            "ROS 2: domain {}, {}",
            network.domain,
            if network.local {
                "on this computer only"
            } else {
                "on all networks of this computer; ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST keeps it here"
            }
        );
        let endpoints = Endpoints::new(participant)?;
        let mailbox: Arc<Mailbox> = Arc::default();
        let (new, ends) = channel();
        let sender = Publisher {
            graph: endpoints.writer(
                "ros_discovery_info",
                "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
                Delivery::Latched,
            )?,
            transforms: endpoints.publisher("/tf_static", "tf2_msgs/msg/TFMessage", Delivery::Latched)?,
            diagnostics: endpoints.publisher(
                "/diagnostics",
                "diagnostic_msgs/msg/DiagnosticArray",
                Delivery::Reliable,
            )?,
            participant: endpoints.participant().guid(),
            network,
            namespace: if namespace.is_empty() { "/" } else { &namespace }.to_owned(),
            mailbox: Arc::clone(&mailbox),
            new: ends,
            ends: Vec::new(),
            leaving: Vec::new(),
            listeners: Listeners::default(),
            sum: (Sent::default(), 0),
        };
        let events = endpoints.participant().status_listener();
        let thread = std::thread::Builder::new()
            .name("ros2".to_owned())
            .spawn(move || sender.run(&events))?;
        Ok(Self {
            mailbox,
            namespace,
            endpoints,
            names: Mutex::default(),
            new,
            thread: Some(thread),
        })
    }

    /// The node of a skin.
    ///
    /// # Errors
    /// Two skins have the same name in ROS 2, or DDS makes no endpoint.
    pub(crate) fn node(&self, of: &Described<'_>) -> Result<Node> {
        let name = messages::name(of.skin.unwrap_or(SKIN));
        let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        if names.contains(&name) {
            bail!("two skins have the name {name} in ROS 2, where a name has letters, digits and _ only; rename one");
        }
        let (namespace, ends) = (&self.namespace, &self.endpoints);
        let topic = |of: &str| format!("{namespace}/{name}/{of}");
        let publisher = |of: &str, kind: &str, delivery| ends.publisher(&topic(of), kind, delivery);
        let (requests, replies) = ends.server(&topic("tare"), "std_srvs/srv/Trigger")?;
        let touches = publisher("touches", "skin_msgs/msg/Touches", Delivery::Reliable)?;
        let image = publisher("image", "sensor_msgs/msg/Image", Delivery::SensorData)?;
        let points = publisher("points", "sensor_msgs/msg/PointCloud2", Delivery::SensorData)?;
        let diagnostics = publisher("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", Delivery::Reliable)?;
        say!("ROS 2: node {namespace}/{name}, touches on {}", touches.topic);
        let node = Node::new(&self.mailbox, !of.live);
        let sheet_frame = messages::sheet_frame(&name);
        let ends = Ends {
            slot: node.slot(),
            serial: of.serial.to_owned(),
            link: of
                .place
                .map_or_else(|| sheet_frame.clone(), |place| place.frame.clone()),
            pose: Pose::of(of.place),
            sheet_frame,
            touches,
            image,
            points,
            diagnostics,
            requests,
            replies: Replies::new(replies),
            sent: Sent::default(),
            told: Sent::default(),
            name: name.clone(),
        };
        self.new.send(ends).ok().context("the thread of ROS 2 has ended")?;
        names.push(name);
        Ok(node)
    }
}

impl Drop for Ros2 {
    fn drop(&mut self) {
        self.mailbox.lock().ended = true;
        self.mailbox.ring();
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            say!("warning: the thread of ROS 2 ended badly");
        }
    }
}

/// A namespace with a slash before every part; that of all is empty.
fn namespace(text: &str) -> Result<String> {
    let within = text.trim_matches('/');
    if within.is_empty() {
        return Ok(String::new());
    }
    let parts: Vec<&str> = within.split('/').collect();
    if let Some(wrong) = parts
        .iter()
        .find(|part| part.is_empty() || messages::name(part) != **part)
    {
        bail!("--ros2 {text}: \"{wrong}\" is no name in ROS 2; give letters, digits and _, such as /robot1");
    }
    Ok(parts.iter().map(|part| format!("/{part}")).collect())
}

/// Who listens to whom.
#[derive(Default)]
struct Listeners {
    of: HashMap<GUID, HashSet<GUID>>,
    /// Topics of which somebody wants more than is given, as it was said.
    said: HashSet<GUID>,
}

impl Listeners {
    fn count(&self, writer: &Writer) -> usize {
        self.of.get(&writer.guid()).map_or(0, HashSet::len)
    }

    fn readers(&self, writer: &Writer) -> HashSet<GUID> {
        self.of.get(&writer.guid()).cloned().unwrap_or_default()
    }
}

/// Sends everything.
struct Publisher {
    graph: Writer,
    transforms: Writer,
    diagnostics: Writer,
    participant: GUID,
    network: Network,
    namespace: String,
    mailbox: Arc<Mailbox>,
    new: Receiver<Ends>,
    ends: Vec<Ends>,
    /// Skins that have ended, and when.
    leaving: Vec<(Ends, Instant)>,
    listeners: Listeners,
    /// Of skins that have ended: what was sent, and how many they were.
    sum: (Sent, usize),
}

impl Publisher {
    fn run(mut self, events: &DomainParticipantStatusListener) {
        let mut told = Instant::now();
        loop {
            let (work, ended) = self.work();
            self.begin_new();
            for (slot, work) in work.into_iter().enumerate() {
                self.do_work(slot, work);
            }
            while let Some(event) = events.try_recv_status() {
                self.heed(event);
            }
            self.answer();
            self.requests();
            self.leaving.retain(|(_, since)| since.elapsed() < LAST);
            if told.elapsed() >= DIAGNOSTICS {
                told = Instant::now();
                self.tell();
            }
            if ended {
                break;
            }
        }
        while let Some(ends) = self.ends.pop() {
            self.end(ends);
        }
        let until = Instant::now() + LAST;
        for (ends, _) in &self.leaving {
            for writer in [&ends.touches, &ends.replies.writer] {
                writer.wait(until.saturating_duration_since(Instant::now()));
            }
        }
        let (sent, skins) = self.sum;
        let of = if skins == 1 {
            "1 skin".to_owned()
        } else {
            format!("{skins} skins")
        };
        say!(
            "ROS 2: {} frames of {of} sent, {} passed over for newer ones, {} messages refused",
            sent.frames,
            sent.passed_over,
            sent.refused
        );
    }

    /// What waits, and whether it is the last.
    fn work(&self) -> (Vec<Work>, bool) {
        let mut inner = self.mailbox.wait(LOOK);
        let ended = inner.ended;
        let work = inner.slots.iter_mut().map(|slot| Work {
            samples: slot.waiting.drain(..).collect(),
            answers: slot.tare.answers(),
            passed_over: slot.passed_over,
            ended: slot.ended,
        });
        (work.collect(), ended)
    }

    /// Takes new nodes in, and tells other nodes of them.
    fn begin_new(&mut self) {
        let before = self.ends.len();
        self.ends.extend(self.new.try_iter());
        if self.ends.len() > before {
            self.tell_graph();
        }
    }

    /// Who is here, and where: readers that come later get it too.
    fn tell_graph(&self) {
        self.graph.send(self.entities());
        let placed = self.ends.iter().filter(|ends| ends.link != ends.sheet_frame);
        let transforms: Vec<_> = placed
            .map(|e| (e.link.as_str(), e.sheet_frame.as_str(), &e.pose))
            .collect();
        if !transforms.is_empty() {
            let now = unix_ns(unix_s(SystemTime::now()));
            self.transforms.send(messages::transforms(now, &transforms));
        }
    }

    /// `rmw_dds_common/ParticipantEntitiesInfo`: which endpoints are whose.
    fn entities(&self) -> Cdr {
        let mut message = Cdr::new();
        let gid = |message: &mut Cdr, of: GUID| {
            let mut octets = of.to_bytes().to_vec();
            octets.resize(self.network.gid, 0);
            message.octets(&octets);
        };
        gid(&mut message, self.participant);
        message.u32(self.ends.len() as u32);
        for ends in &self.ends {
            message.text(&self.namespace).text(&ends.name).u32(1);
            gid(&mut message, ends.requests.guid());
            let own = [
                &ends.touches,
                &ends.image,
                &ends.points,
                &ends.diagnostics,
                &ends.replies.writer,
            ];
            let shared = [&self.graph, &self.transforms, &self.diagnostics];
            message.u32((own.len() + shared.len()) as u32);
            for writer in own.into_iter().chain(shared) {
                gid(&mut message, writer.guid());
            }
        }
        message
    }

    fn do_work(&mut self, slot: usize, work: Work) {
        let Some(at) = self.ends.iter().position(|ends| ends.slot == slot) else {
            return;
        };
        let ends = &mut self.ends[at];
        for sample in &work.samples {
            ends.send(sample, self.listeners.count(&ends.points) > 0);
        }
        ends.sent.passed_over = work.passed_over;
        for (request, success, text) in work.answers {
            ends.replies.add(request, success, text);
        }
        if work.ended {
            let ends = self.ends.remove(at);
            self.end(ends);
            self.tell_graph();
        }
    }

    /// A skin that has ended stays until its last messages have arrived.
    fn end(&mut self, mut ends: Ends) {
        ends.replies.send_all();
        let (sum, skins) = &mut self.sum;
        sum.frames += ends.sent.frames;
        sum.passed_over += ends.sent.passed_over;
        sum.refused += ends.sent.refused;
        *skins += 1;
        self.leaving.push((ends, Instant::now()));
    }

    /// Asks for baselines where somebody does.
    fn requests(&mut self) {
        for ends in &self.ends {
            while let Some((from, body)) = ends.requests.take() {
                let Some(request) = Request::read(from, &body) else {
                    say!(
                        "warning: {}: a request that is no std_srvs/Trigger",
                        ends.replies.writer.topic
                    );
                    continue;
                };
                let mut inner = self.mailbox.lock();
                let slot = &mut inner.slots[ends.slot];
                slot.tare.ask(request, &slot.sheet);
            }
        }
    }

    /// Sends the answers that can be heard.
    fn answer(&mut self) {
        for ends in &mut self.ends {
            ends.replies.send_ready(&self.listeners.readers(&ends.replies.writer));
        }
    }

    /// Takes note of who comes and goes.
    fn heed(&mut self, event: DomainParticipantStatusEvent) {
        let of = &mut self.listeners.of;
        match event {
            DomainParticipantStatusEvent::RemoteReaderMatched {
                local_writer,
                remote_reader,
            } => {
                of.entry(local_writer).or_default().insert(remote_reader);
            }
            DomainParticipantStatusEvent::ReaderLost { guid, .. } => {
                of.values_mut().for_each(|readers| {
                    readers.remove(&guid);
                });
            }
            DomainParticipantStatusEvent::ParticipantLost { id, .. } => {
                of.values_mut()
                    .for_each(|readers| readers.retain(|reader| reader.prefix != id));
            }
            DomainParticipantStatusEvent::RemoteReaderQosIncompatible { local_writer, .. } => {
                self.say_incompatible(local_writer);
                return;
            }
            _ => return,
        }
        let mut inner = self.mailbox.lock();
        for ends in &mut self.ends {
            inner.slots[ends.slot].image_wanted = self.listeners.count(&ends.image) > 0;
            ends.sent.subscribers = self.listeners.count(&ends.touches);
        }
    }

    fn say_incompatible(&mut self, writer: GUID) {
        let of_skins = self
            .ends
            .iter()
            .flat_map(|e| [&e.touches, &e.image, &e.points, &e.diagnostics]);
        let Some(writer) = of_skins.into_iter().find(|w| w.guid() == writer) else {
            return;
        };
        if self.listeners.said.insert(writer.guid()) {
            let given = match writer.delivery {
                Delivery::SensorData => "best effort, volatile",
                Delivery::Reliable => "reliable, volatile",
                Delivery::Latched => "reliable, transient local",
            };
            say!(
                "warning: somebody asks for more of {} than it gives ({given}), and gets nothing; subscribe with the sensor data profile",
                writer.topic
            );
        }
    }

    /// Tells how all skins are.
    fn tell(&mut self) {
        let now_s = unix_s(SystemTime::now());
        for ends in &mut self.ends {
            let statuses = {
                let mut inner = self.mailbox.lock();
                let facts = &mut inner.slots[ends.slot].facts;
                facts.statuses(&ends.name, now_s, &ends.sent, &ends.told)
            };
            ends.told = ends.sent;
            for writer in [&ends.diagnostics, &self.diagnostics] {
                writer.send(messages::diagnostics(unix_ns(now_s), &ends.serial, &statuses));
            }
        }
    }
}

impl Ends {
    fn send(&mut self, sample: &Sample, points: bool) {
        let stamp = unix_ns(sample.unix_s);
        let header = |frame| Header { unix_ns: stamp, frame };
        let doubt = sample.doubt.as_deref().unwrap_or("");
        let of_sheet = header(self.sheet_frame.as_str());
        let message = messages::touches(of_sheet, sample.sequence, sample.time_s, &sample.touches, doubt);
        let mut taken = [self.touches.send(message), true, true];
        if points {
            let message = messages::points(header(self.link.as_str()), &self.pose, &sample.touches);
            taken[1] = self.points.send(message);
        }
        if let Some((imager, rise)) = &sample.image {
            taken[2] = self.image.send(messages::image(of_sheet, &imager.grid, rise));
        }
        self.sent.frames += 1;
        self.sent.refused += taken.iter().filter(|taken| !**taken).count() as u64;
    }
}

/// What a skin has for the thread.
struct Work {
    samples: Vec<Sample>,
    answers: Vec<(Request, bool, String)>,
    passed_over: u64,
    ended: bool,
}

#[cfg(test)]
mod tests {
    use super::namespace;

    #[test]
    fn a_namespace_has_a_slash_before_every_part() {
        assert_eq!(namespace("robot1").unwrap(), "/robot1");
        assert_eq!(namespace("/robot_1/arm/").unwrap(), "/robot_1/arm");
        assert_eq!(namespace("/").unwrap(), "");
        for wrong in ["a//b", "robot-1", "1st"] {
            assert!(namespace(wrong).is_err(), "{wrong}");
        }
    }
}
