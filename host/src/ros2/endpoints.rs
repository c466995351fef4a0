//! Writers and readers of DDS as ROS 2 names and sets them, for messages that are encoded already.

use crate::files::cdr::Cdr;
use anyhow::{Context, Result};
use rustdds::bytes::Bytes;
use rustdds::no_key::{DataWriter, Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter, SimpleDataReader};
use rustdds::policy::{Deadline, Durability, History, Lifespan, Liveliness, Reliability};
use rustdds::rpc::SampleIdentity;
use rustdds::{
    DomainParticipant, Duration, GUID, Publisher, QosPolicies, QosPolicyBuilder, RTPSEntity, RepresentationIdentifier,
    Subscriber, Timestamp, Topic, TopicKind, WriteOptionsBuilder,
};
use std::convert::Infallible;

/// How messages of a topic are delivered; the names are those of ROS 2's profiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Delivery {
    /// Reliable, nothing kept for those who come later.
    Reliable,
    /// Best effort: what is lost is not sent again.
    SensorData,
    /// Reliable, and who comes later gets the last message.
    Latched,
}

impl Delivery {
    fn qos(self) -> QosPolicies {
        let reliability = match self {
            Self::SensorData => Reliability::BestEffort,
            // Where no reader takes anything for so long that all memory is full, a message is lost, and counted.
            Self::Reliable | Self::Latched => Reliability::Reliable {
                max_blocking_time: Duration::ZERO,
            },
        };
        let (durability, depth) = match self {
            Self::Reliable => (Durability::Volatile, 10),
            Self::SensorData => (Durability::Volatile, 5),
            Self::Latched => (Durability::TransientLocal, 1),
        };
        QosPolicyBuilder::new()
            .reliability(reliability)
            .durability(durability)
            .history(History::KeepLast { depth })
            .deadline(Deadline(Duration::INFINITE))
            .lifespan(Lifespan {
                duration: Duration::INFINITE,
            })
            .liveliness(Liveliness::Automatic {
                lease_duration: Duration::INFINITE,
            })
            .build()
    }
}

/// What hands encoded messages through.
pub(super) struct Encoded;

impl SerializerAdapter<Bytes> for Encoded {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Bytes) -> Result<Bytes, Infallible> {
        Ok(value.clone())
    }
}

impl DeserializerAdapter<Vec<u8>> for Encoded {
    type Error = Infallible;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE]
    }

    fn transform_decoded(decoded: Vec<u8>) -> Vec<u8> {
        decoded
    }
}

/// Takes the bytes as they are.
#[derive(Clone)]
pub(super) struct AsTheyAre;

impl<'de> Decode<'de, Vec<u8>> for AsTheyAre {
    type Error = Infallible;

    fn decode_bytes(self, bytes: &'de [u8], _: RepresentationIdentifier) -> Result<Vec<u8>, Infallible> {
        Ok(bytes.to_vec())
    }
}

impl DefaultDecoder<Vec<u8>> for Encoded {
    type Decoder = AsTheyAre;
    const DECODER: AsTheyAre = AsTheyAre;
}

/// Sends messages of a topic.
pub(super) struct Writer {
    writer: DataWriter<Bytes, Encoded>,
    /// As people know it.
    pub(super) topic: String,
    pub(super) delivery: Delivery,
}

impl Writer {
    pub(super) fn guid(&self) -> GUID {
        self.writer.guid()
    }

    /// Sends a message; whether it was taken.
    pub(super) fn send(&self, message: Cdr) -> bool {
        self.writer.write(body(message), Some(Timestamp::now())).is_ok()
    }

    /// Waits until all readers have all of it, at most so long; whether they have.
    pub(super) fn wait(&self, most: std::time::Duration) -> bool {
        self.writer.wait_for_acknowledgments(most).unwrap_or(false)
    }

    /// Answers a request.
    pub(super) fn answer(&self, message: Cdr, request: SampleIdentity) -> bool {
        let options = WriteOptionsBuilder::new()
            .source_timestamp(Timestamp::now())
            .related_sample_identity(request)
            .build();
        self.writer.write_with_options(body(message), options).is_ok()
    }
}

/// DDS writes the head of the encoding by itself.
fn body(message: Cdr) -> Bytes {
    Bytes::from(message.into_bytes()).split_off(Cdr::HEAD.len())
}

/// Takes requests.
pub(super) struct Reader(SimpleDataReader<Vec<u8>, Encoded>);

impl Reader {
    pub(super) fn guid(&self) -> GUID {
        self.0.guid()
    }

    /// The next request, where there is one, with whom to answer. What cannot be read is passed over.
    pub(super) fn take(&self) -> Option<(SampleIdentity, Vec<u8>)> {
        self.0.drain_read_notifications();
        let taken = self.0.try_take_one().ok().flatten()?;
        let from = SampleIdentity {
            writer_guid: taken.writer_guid,
            sequence_number: taken.sequence_number,
        };
        Some((from, taken.sample))
    }
}

/// Makes endpoints.
pub(super) struct Endpoints {
    participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
}

impl Endpoints {
    pub(super) fn new(participant: DomainParticipant) -> Result<Self> {
        let qos = QosPolicyBuilder::new().build();
        Ok(Self {
            publisher: participant.create_publisher(&qos)?,
            subscriber: participant.create_subscriber(&qos)?,
            participant,
        })
    }

    pub(super) fn participant(&self) -> &DomainParticipant {
        &self.participant
    }

    fn topic(&self, name: &str, kind: &str, delivery: Delivery) -> Result<Topic> {
        let topic = self
            .participant
            .create_topic(name.to_owned(), kind.to_owned(), &delivery.qos(), TopicKind::NoKey);
        topic.with_context(|| format!("the topic {name} of ROS 2"))
    }

    /// Of a topic as DDS names it.
    pub(super) fn writer(&self, dds_name: &str, kind: &str, delivery: Delivery) -> Result<Writer> {
        let topic = self.topic(dds_name, kind, delivery)?;
        let writer = self.publisher.create_datawriter_no_key(&topic, None)?;
        Ok(Writer {
            writer,
            topic: dds_name.trim_start_matches("rt").to_owned(),
            delivery,
        })
    }

    /// Of a topic of messages: `/left/touches` of `skin_msgs/msg/Touches`.
    pub(super) fn publisher(&self, topic: &str, kind: &str, delivery: Delivery) -> Result<Writer> {
        self.writer(&format!("rt{topic}"), &type_name(kind), delivery)
    }

    /// The two ends of a service's server.
    pub(super) fn server(&self, service: &str, kind: &str) -> Result<(Reader, Writer)> {
        let topic = self.topic(
            &format!("rq{service}Request"),
            &type_name(&format!("{kind}_Request")),
            Delivery::Reliable,
        )?;
        let requests = self.subscriber.create_simple_datareader_no_key(&topic, None)?;
        let replies = self.writer(
            &format!("rr{service}Reply"),
            &type_name(&format!("{kind}_Response")),
            Delivery::Reliable,
        )?;
        Ok((Reader(requests), replies))
    }
}

/// `skin_msgs/msg/Touches` as DDS names it.
fn type_name(kind: &str) -> String {
    let (package, name) = kind.rsplit_once('/').unwrap_or(("", kind));
    format!("{}::dds_::{name}_", package.replace('/', "::"))
}

#[cfg(test)]
mod tests {
    use super::type_name;

    #[test]
    fn types_have_the_names_that_ros_gives_them() {
        assert_eq!(
            type_name("sensor_msgs/msg/PointCloud2"),
            "sensor_msgs::msg::dds_::PointCloud2_"
        );
        assert_eq!(
            type_name("std_srvs/srv/Trigger_Request"),
            "std_srvs::srv::dds_::Trigger_Request_"
        );
    }
}
