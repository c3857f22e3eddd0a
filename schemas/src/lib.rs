//! Every message on the bus, and **the** table of topics.
//!
//! Read [`topics`] first: topic, type, writer, readers and rate of everything that crosses the arena. The
//! bytes of a body are ROS 1 serialization; the definitions generated from these types are in
//! `schemas/published/`.

mod arena;
mod device;
mod journal;
mod latency;
mod logger;
mod maneuver;
mod mocap;
mod plant;
mod replay;
mod topic;
mod vehicle;

pub use arena::{ArenaOrder, NodeEvent, NodeHealth, OrderKind, Severity, StopKind, StopOrder};
pub use device::DeviceBytes;
pub use journal::{JournalStep, JournalStream, NodeJournal};
pub use latency::{LatencyHop, NodeLatency};
pub use logger::{LoggerOrder, LoggerOrderKind, LoggerState, LoggerStatus};
pub use maneuver::{
    FlipError, FlipOutcome, FlipParameters, FlipPhase, FlipStatus, LearnerVerdict, ManeuverAbort,
    ManeuverParameters, ManeuverResult, ManeuverStart, ManeuverUpload,
};
pub use mocap::{MocapBody, MocapFrame};
pub use plant::{PlantManeuver, PlantTruth};
pub use replay::{ReplayAnswer, ReplayClock, ReplayState};
pub use topic::{Topic, topic_hash};
pub use vehicle::{
    CommandMode, CommandSent, FlightMode, GoalKind, Kinematics, ManeuverPhase, Tracking, VehicleCommand,
    VehicleGoal, VehicleState, VehicleTelemetry,
};

/// The topic table. One writer each; where a topic speaks of several vehicles, the message names its vehicle.
pub mod topics {
    use super::{
        ArenaOrder, CommandSent, DeviceBytes, FlipStatus, LoggerOrder, LoggerStatus, ManeuverAbort,
        ManeuverParameters, ManeuverResult, ManeuverStart, ManeuverUpload, MocapFrame, NodeEvent, NodeHealth,
        NodeJournal, NodeLatency, PlantManeuver, PlantTruth, ReplayAnswer, ReplayClock, StopOrder, Topic,
        VehicleCommand, VehicleGoal, VehicleState, VehicleTelemetry,
    };

    crate::topic::table! {
        /// Bytes from the motion-capture system.
        VICON_RX: DeviceBytes = "vicon/rx", by "vicon-bridge", for ["vicon-bridge"], at 200;
        /// Bytes to the motion-capture system: OptiTrack's must be asked.
        VICON_TX: DeviceBytes = "vicon/tx", by "vicon-bridge", for [], at 1;
        /// Poses.
        MOCAP_FRAME: MocapFrame = "mocap/frame", by "vicon-bridge", for ["estimator", "flip-manager"], at 200;
        /// Estimates and predictions.
        VEHICLE_STATE: VehicleState = "vehicle/state", by "estimator",
            for ["hover-controller", "flip-manager", "arena"], at 200;
        /// Commands.
        VEHICLE_COMMAND: VehicleCommand = "vehicle/command", by "hover-controller", for ["radio-bridge"], at 200;
        /// What went out in each radio slot.
        COMMAND_SENT: CommandSent = "vehicle/command-sent", by "radio-bridge", for ["estimator"], at 50;
        /// What the vehicles say of themselves.
        VEHICLE_TELEMETRY: VehicleTelemetry = "vehicle/telemetry", by "radio-bridge",
            for ["estimator", "hover-controller", "flip-manager"], at 20;
        /// Where the vehicles shall be.
        VEHICLE_GOAL: VehicleGoal = "vehicle/goal", by "flip-manager", for ["hover-controller"], at 10;
        /// Parameter sets for the vehicles' stores.
        MANEUVER_UPLOAD: ManeuverUpload = "maneuver/upload", by "flip-manager", for ["radio-bridge"], at 1;
        /// Orders to begin.
        MANEUVER_START: ManeuverStart = "maneuver/start", by "flip-manager", for ["radio-bridge"], at 1;
        /// Orders to end early.
        MANEUVER_ABORT: ManeuverAbort = "maneuver/abort", by "flip-manager", for ["radio-bridge"], at 1;
        /// The learner's next parameters.
        MANEUVER_PARAMETERS: ManeuverParameters = "maneuver/parameters", by "learner",
            for ["flip-manager"], at 2, latched;
        /// How each flip ended.
        MANEUVER_RESULT: ManeuverResult = "maneuver/result", by "flip-manager", for ["learner", "arena"], at 1;
        /// What the flip manager is doing.
        FLIP_STATUS: FlipStatus = "maneuver/status", by "flip-manager", for ["arena"], at 10;
        /// Bytes to the radios.
        RADIO_TX: DeviceBytes = "radio/tx", by "radio-bridge", for [], at 100;
        /// Bytes from the radios.
        RADIO_RX: DeviceBytes = "radio/rx", by "radio-bridge", for ["radio-bridge"], at 20;
        /// What people want.
        ARENA_ORDER: ArenaOrder = "arena/order", by "arena", for ["flip-manager"], at 2, latched;
        /// The emergency stop; needs no lease.
        STOP_ORDER: StopOrder = "arena/stop", by "arena", for ["radio-bridge"], at 50;
        /// Faults and turns of events.
        NODE_EVENT: NodeEvent = "node/event", by "*", for ["arena"], at 1;
        /// How each node fares.
        NODE_HEALTH: NodeHealth = "node/health", by "*", for ["arena"], at 1;
        /// What each node took, when, and what it said to it: what a re-execution needs.
        NODE_JOURNAL: NodeJournal = "node/journal", by "*", for [], at 10;
        /// Where the time goes, node by node; live only.
        NODE_LATENCY: NodeLatency = "node/latency", by "*", for [], at 1;
        /// How the recording fares.
        LOGGER_STATUS: LoggerStatus = "logger/status", by "logger", for ["flip-manager"], at 2;
        /// What people want of the logger.
        LOGGER_ORDER: LoggerOrder = "logger/order", by "arena", for ["logger"], at 1;
        /// The time of a replay, which every shell of the replay domain lives by.
        REPLAY_CLOCK: ReplayClock = "replay/clock", by "playback", for [], at 200;
        /// What each node of a replay in lock step answers to its clock.
        REPLAY_ANSWER: ReplayAnswer = "node/replay-answer", by "*", for ["playback"], at 200;
        /// The truth, where there is a simulator to know it.
        PLANT_TRUTH: PlantTruth = "plant/truth", by "simulator", for [], at 50;
        /// How maneuvers truly ended.
        PLANT_MANEUVER: PlantManeuver = "plant/maneuver", by "simulator", for [], at 1;
    }

    /// The topic of that name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<&'static Topic> {
        ALL.iter().copied().find(|topic| topic.name == name)
    }
}
