//! What is known of the recording: nobody takes off onto a disk that is about to fill (hazard H20).

use quantity::{Span, Time};
use schemas::LoggerStatus;

use crate::tuning::RecordingTuning;

const GIB_BYTES: f64 = 1_073_741_824.0;

/// The logger's newest word, if there is a logger.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Recording {
    newest: Option<(Time, u64)>,
}

impl Recording {
    pub(crate) fn hear(&mut self, now: Time, status: &LoggerStatus) {
        self.newest = Some((now, status.free_bytes));
    }

    /// Why nobody may take off; an arena without a logger flies all the same.
    pub(crate) fn refusal(&self, now: Time, tuning: &RecordingTuning) -> Option<String> {
        let (heard_at, free_bytes) = self.newest?;
        let free_gib = free_bytes as f64 / GIB_BYTES;
        let fresh = now - heard_at <= Span::from_secs_f64(tuning.status_age_s_max);
        (fresh && free_gib < tuning.free_gib_min).then(|| {
            format!(
                "{free_gib:.2} GiB free for the recording, at least {:.2} GiB are needed to take off",
                tuning.free_gib_min
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Time = Time::from_nanos(10_000_000_000);

    fn heard(free_bytes: u64) -> Recording {
        let mut recording = Recording::default();
        recording.hear(NOW, &LoggerStatus { free_bytes, ..LoggerStatus::default() });
        recording
    }

    #[test]
    fn only_a_fresh_word_of_too_little_room_refuses() {
        let tuning = RecordingTuning::default();
        assert_eq!(Recording::default().refusal(NOW, &tuning), None, "no logger, no refusal");
        assert_eq!(heard(2 << 30).refusal(NOW, &tuning), None);
        let refusal = heard((2 << 30) - 1).refusal(NOW, &tuning).unwrap();
        assert!(refusal.contains("2.00 GiB free"), "{refusal}");
        assert_eq!(heard(0).refusal(NOW + Span::from_millis(3_001), &tuning), None, "its logger is gone");
    }
}
