//! An arena that runs already: its devices are its own, so it is asked instead of them.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use schemas::{MocapFrame, NodeHealth, VehicleTelemetry, topics};
use service_core::{Observed, Observer, decode};
use service_shell::{BusReceiver, Listen, Setup, ShellError};
use settings::Arena;

use super::finding::Finding;

/// Every node tells of itself once a second.
const LISTENING: Duration = Duration::from_millis(2_200);
/// What is less than this a second has holes.
const FRAMES_A_SECOND_MIN: u32 = 95;

/// What an arena said of itself and its devices.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Heard {
    nodes: BTreeSet<String>,
    frames: u32,
    seen: BTreeMap<u8, u32>,
    telemetry: BTreeMap<u8, u32>,
}

/// Listens for two seconds.
pub fn listen(setup: &Setup) -> Result<Heard, ShellError> {
    let (network, domain) = (&setup.arena.network, setup.identity.domain);
    let mut observer = Observer::new(&setup.secret, domain, setup.identity.run);
    let mut heard = Heard::default();
    let listening = async {
        let wanted = [&topics::NODE_HEALTH, &topics::MOCAP_FRAME, &topics::VEHICLE_TELEMETRY];
        let mut bus = BusReceiver::join(network, domain, Listen::Topics(&wanted))?;
        loop {
            for index in 0..bus.next_batch().await? {
                // What is not authentic is nobody's word.
                if let Ok(observed) = observer.observe(bus.datagram(index).bytes)
                    && observed.verified
                {
                    heard.take(&observed);
                }
            }
        }
    };
    service_shell::block_on(async {
        let ended: Result<Result<(), ShellError>, _> = tokio::time::timeout(LISTENING, listening).await;
        ended.unwrap_or(Ok(()))
    })?;
    Ok(heard)
}

impl Heard {
    fn take(&mut self, observed: &Observed<'_>) {
        let name = observed.topic.name();
        if name == topics::NODE_HEALTH.name
            && let Ok(health) = decode::<NodeHealth>(observed.body)
        {
            self.nodes.insert(health.node.to_string());
        } else if name == topics::MOCAP_FRAME.name
            && let Ok(frame) = decode::<MocapFrame>(observed.body)
        {
            self.frames += 1;
            for body in frame.bodies.iter() {
                *self.seen.entry(body.vehicle).or_default() += 1;
            }
        } else if name == topics::VEHICLE_TELEMETRY.name
            && let Ok(report) = decode::<VehicleTelemetry>(observed.body)
        {
            *self.telemetry.entry(report.vehicle).or_default() += 1;
        }
    }
}

/// What to think of an arena that was heard, but not as one of ours.
pub fn strangers(topic: &str) -> Finding {
    Finding::warn(
        "arena",
        format!(
            "another one runs: {topic} was heard, of another run or secret; its devices are not looked at"
        ),
        "run this in the folder in which that arena was brought up",
    )
}

/// What to think of an arena that runs, and of its devices by its own account.
pub fn judge(arena: &Arena, services: &[&str], heard: &Heard) -> Vec<Finding> {
    let seconds = LISTENING.as_secs_f64();
    let listed = |ids: &[u8]| ids.iter().map(u8::to_string).collect::<Vec<_>>().join(", ");
    let absent_in = |counts: &BTreeMap<u8, u32>| {
        let ids = arena.fleet.iter().map(|member| member.vehicle.id);
        ids.filter(|id| !counts.contains_key(id)).collect::<Vec<u8>>()
    };
    let silent: Vec<&str> = services.iter().copied().filter(|name| !heard.nodes.contains(*name)).collect();
    let running = if silent.is_empty() {
        Finding::ok("arena", "it runs, and every service is heard")
    } else {
        let advice = "look into .flyarena/logs/";
        Finding::fail("arena", format!("it runs without {}", silent.join(", ")), advice)
    };
    let rate = (f64::from(heard.frames) / seconds).round();
    let (found, unseen) =
        (format!("{rate} frames a second, by the bridge's account"), absent_in(&heard.seen));
    let capture = if heard.frames == 0 {
        Finding::fail(
            "motion capture",
            "no frame, by the bridge's account",
            "see that its frames reach this host",
        )
    } else if !unseen.is_empty() {
        let advice = "name them at the motion capture as in the settings, and put them in sight";
        Finding::fail("motion capture", format!("{found}; vehicles {} not seen", listed(&unseen)), advice)
    } else if rate < f64::from(FRAMES_A_SECOND_MIN) {
        Finding::warn("motion capture", found, "set it to 100 frames a second or more")
    } else {
        Finding::ok("motion capture", found)
    };
    let unheard = absent_in(&heard.telemetry);
    let radio = if unheard.is_empty() {
        Finding::ok("radios", "telemetry of every vehicle comes, by the bridge's account")
    } else {
        let advice = "switch them on; see the section XBee of docs/hardware.md";
        Finding::fail("radios", format!("no telemetry of vehicles {}", listed(&unheard)), advice)
    };
    vec![running, capture, radio]
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn an_arena_is_judged_by_its_nodes_its_frames_and_its_telemetry() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let arena = Arena::load(&folder, "double-flip").unwrap();
        let services = ["estimator", "learner"];
        let verdicts = |heard: &Heard| -> Vec<Verdict> {
            judge(&arena, &services, heard).iter().map(|finding| finding.verdict).collect()
        };
        let nodes = services.iter().map(|name| (*name).to_owned()).collect();
        let all = || BTreeMap::from([(1, 40)]);
        let fine = Heard { nodes, frames: 440, seen: all(), telemetry: all() };
        assert_eq!(verdicts(&fine), [Verdict::Ok, Verdict::Ok, Verdict::Ok]);
        assert_eq!(verdicts(&Heard::default()), [Verdict::Fail, Verdict::Fail, Verdict::Fail]);
        let slow = Heard { frames: 100, ..fine };
        assert_eq!(verdicts(&slow), [Verdict::Ok, Verdict::Warn, Verdict::Ok]);
    }
}
