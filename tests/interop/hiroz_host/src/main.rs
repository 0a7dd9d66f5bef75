//! A ROS 2 node by hiroz, an implementation of ROS 2 over Zenoh that nobody here wrote: what it sees of ours.
//!
//!     hiroz_host listen ENDPOINT DOMAIN SECONDS TOPIC...     subscribes to Imu, NavSatFix, … by the topic's last name;
//!                                                            prints one JSON object at the end
//!     hiroz_host talk ENDPOINT DOMAIN SECONDS RATE TOPIC     publishes Imu, numbered in orientation_covariance[8]
//!
//! Built by `cargo build --release` in this folder, with Rust 1.95; takes ten minutes on a small machine.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use hiroz::event::ZenohEventType;
use hiroz::qos::{QosHistory, QosProfile};
use hiroz::{Builder, Result, context::ZContextBuilder};
use hiroz_msgs::diagnostic_msgs::DiagnosticArray;
use hiroz_msgs::geometry_msgs::TwistStamped;
use hiroz_msgs::sensor_msgs::{FluidPressure, Imu, NavSatFix, Temperature, TimeReference};
use hiroz_msgs::std_msgs::Header;
use hiroz_msgs::tf2_msgs::TFMessage;
use serde_json::{Value, json};

/// What came of one topic.
#[derive(Default)]
struct Received {
    count: u64,
    backwards: u64,
    last_stamp: i64,
    last: Vec<Value>,
}

type Found = Arc<Mutex<BTreeMap<String, Received>>>;

const KEPT: usize = 200;

fn stamp(header: &Header) -> i64 {
    header.stamp.sec as i64 * 1_000_000_000 + header.stamp.nanosec as i64
}

fn note(found: &Found, topic: &str, stamp: i64, value: Value) {
    let mut all = found.lock().unwrap();
    let one = all.entry(topic.to_string()).or_default();
    one.count += 1;
    if stamp < one.last_stamp {
        one.backwards += 1;
    }
    one.last_stamp = stamp;
    if one.last.len() == KEPT {
        one.last.remove(0);
    }
    one.last.push(value);
}

fn now() -> i64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap()
        .as_nanos() as i64
}

macro_rules! listen {
    ($node:expr, $found:expr, $losses:expr, $topic:expr, $type:ty, $stamp:expr, $value:expr) => {{
        let (found, topic) = ($found.clone(), $topic.clone());
        let qos = QosProfile {
            history: QosHistory::KeepLast(std::num::NonZeroUsize::new(1000).unwrap()),
            ..Default::default()
        };
        let sub = $node
            .create_sub::<$type>(&$topic)
            .with_qos(qos)
            .build_with_callback(move |message: $type| {
                let (stamp_of, value_of): (fn(&$type) -> i64, fn(&$type) -> Value) =
                    ($stamp, $value);
                let stamp = stamp_of(&message);
                let mut value = value_of(&message);
                value["stamp"] = json!(stamp);
                value["at"] = json!(now());
                note(&found, &topic, stamp, value);
            })?;
        let (events, topic) = (sub.events_mgr().clone(), $topic.clone());
        $losses.push(Box::new(move || {
            let lost = events
                .lock()
                .unwrap()
                .take_event_status(ZenohEventType::MessageLost)
                .total_count;
            let _ = &sub; // lives as long as this closure
            (topic.clone(), lost as i64)
        }) as Box<dyn Fn() -> (String, i64)>);
    }};
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.len() < 5 {
        eprintln!("hiroz_host listen|talk ENDPOINT DOMAIN SECONDS …");
        std::process::exit(2);
    }
    let domain: usize = arguments[2].parse()?;
    let seconds: f64 = arguments[3].parse()?;
    let context = ZContextBuilder::default()
        .with_domain_id(domain)
        .with_router_endpoint(arguments[1].clone())?
        .build()?;
    let node = context.create_node("hiroz_host").build()?;
    if arguments[0] == "talk" {
        return talk(&node, seconds, arguments[4].parse()?, &arguments[5]);
    }

    let found: Found = Arc::default();
    let mut losses: Vec<Box<dyn Fn() -> (String, i64)>> = Vec::new();
    for topic in &arguments[4..] {
        match topic.rsplit('/').next().unwrap() {
            "data" | "data_raw" => listen!(
                node,
                found,
                losses,
                topic,
                Imu,
                |m: &Imu| stamp(&m.header),
                |m: &Imu| json!({
                    "frame": m.header.frame_id,
                    "orientation": [m.orientation.w, m.orientation.x, m.orientation.y, m.orientation.z],
                    "turn": [m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z],
                    "acceleration": [m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z],
                    "covariance": [m.orientation_covariance[0], m.angular_velocity_covariance[0], m.linear_acceleration_covariance[0]],
                })
            ),
            "fix" => listen!(
                node,
                found,
                losses,
                topic,
                NavSatFix,
                |m: &NavSatFix| stamp(&m.header),
                |m: &NavSatFix| json!({
                    "place": [m.latitude, m.longitude, m.altitude], "covariance": m.position_covariance.to_vec(),
                })
            ),
            "velocity" => listen!(
                node,
                found,
                losses,
                topic,
                TwistStamped,
                |m: &TwistStamped| stamp(&m.header),
                |m: &TwistStamped| json!({
                    "frame": m.header.frame_id, "linear": [m.twist.linear.x, m.twist.linear.y, m.twist.linear.z],
                })
            ),
            "time_reference" => listen!(
                node,
                found,
                losses,
                topic,
                TimeReference,
                |m: &TimeReference| stamp(&m.header),
                |m: &TimeReference| json!({
                    "utc": m.time_ref.sec, "source": m.source,
                })
            ),
            "pressure" => listen!(
                node,
                found,
                losses,
                topic,
                FluidPressure,
                |m: &FluidPressure| stamp(&m.header),
                |m: &FluidPressure| json!({
                    "value": m.fluid_pressure,
                })
            ),
            "temperature" => listen!(
                node,
                found,
                losses,
                topic,
                Temperature,
                |m: &Temperature| stamp(&m.header),
                |m: &Temperature| json!({
                    "value": m.temperature,
                })
            ),
            "diagnostics" => listen!(
                node,
                found,
                losses,
                topic,
                DiagnosticArray,
                |m: &DiagnosticArray| stamp(&m.header),
                |m: &DiagnosticArray| json!({
                    "name": m.status[0].name, "message": m.status[0].message, "values": m.status[0].values.len(),
                })
            ),
            "tf" => listen!(
                node,
                found,
                losses,
                topic,
                TFMessage,
                |m: &TFMessage| stamp(&m.transforms[0].header),
                |m: &TFMessage| json!({
                    "parent": m.transforms[0].header.frame_id, "child": m.transforms[0].child_frame_id,
                })
            ),
            other => eprintln!("no type for {other}"),
        }
    }
    std::thread::sleep(Duration::from_secs_f64(seconds));
    let lost: BTreeMap<String, i64> = losses.iter().map(|one| one()).collect();
    let graph = context.graph();
    let received: BTreeMap<String, Value> = found
        .lock()
        .unwrap()
        .iter()
        .map(|(topic, one)| {
            (
                topic.clone(),
                json!({"count": one.count, "backwards": one.backwards, "last": one.last}),
            )
        })
        .collect();
    println!(
        "{}",
        json!({
            "nodes": graph.get_node_names().iter().map(|(name, namespace)| json!([name, namespace])).collect::<Vec<_>>(),
            "topics": graph.get_topic_names_and_types().into_iter().collect::<BTreeMap<String, String>>(),
            "received": received,
            "lost": lost,
        })
    );
    Ok(())
}

fn talk(node: &hiroz::node::ZNode, seconds: f64, rate: f64, topic: &str) -> Result<()> {
    let publisher = node.create_pub::<Imu>(topic).build()?;
    let begin = Instant::now();
    let mut number = 0u64;
    while begin.elapsed().as_secs_f64() < seconds {
        let time = now();
        let mut message = Imu::default();
        message.header.stamp.sec = (time / 1_000_000_000) as i32;
        message.header.stamp.nanosec = (time % 1_000_000_000) as u32;
        message.header.frame_id = "hiroz".into();
        message.orientation.w = 1.0;
        message.angular_velocity.x = (number % 1000) as f64 / 1000.0;
        message.linear_acceleration.z = 9.80665;
        message.orientation_covariance[8] = number as f64;
        publisher.publish(&message)?;
        number += 1;
        let due = begin + Duration::from_secs_f64(number as f64 / rate);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    println!("{}", json!({"published": number}));
    Ok(())
}
