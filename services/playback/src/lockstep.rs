//! Lock step: who takes part, who has answered, and where to stop next.

use std::collections::BTreeMap;

use quantity::Time;
use schemas::ReplayAnswer;

/// Nodes remembered at most: answers are signed with a key that every node holds.
const NODES_MAX: usize = 256;

/// What one node answered last.
#[derive(Clone, Copy, Debug, Default)]
struct Part {
    tick: u64,
    round: u32,
    steps: u64,
    due_at: Time,
}

/// The nodes of a replay in lock step.
#[derive(Clone, Debug, Default)]
pub struct LockStep {
    parts: BTreeMap<String, Part>,
    tick: u64,
    round: u32,
    /// An answer may have been lost, and with it word of steps.
    unsure: bool,
}

impl LockStep {
    /// Asks everybody for a tick in a round; answers to earlier ones no longer count.
    pub fn ask(&mut self, tick: u64, round: u32) {
        (self.tick, self.round, self.unsure) = (tick, round, false);
    }

    /// The same question goes out again: somebody has not heard it, or has not been heard.
    pub fn ask_again(&mut self) {
        self.unsure = true;
    }

    /// Takes note of an answer.
    pub fn take(&mut self, answer: &ReplayAnswer) {
        let node = answer.node.as_str();
        if !self.parts.contains_key(node) && self.parts.len() >= NODES_MAX {
            return;
        }
        let part = self.parts.entry(node.to_owned()).or_default();
        let again = (part.tick, part.round) == (answer.tick, answer.round);
        // Asked again it says what it did since it first answered, which may be nothing.
        let steps = if again { part.steps.saturating_add(answer.steps) } else { answer.steps };
        *part = Part { tick: answer.tick, round: answer.round, steps, due_at: answer.due_at };
    }

    /// How many nodes take part.
    #[must_use]
    pub fn count(&self) -> usize {
        self.parts.len()
    }

    /// Whether a node takes part.
    #[must_use]
    pub fn has(&self, node: &str) -> bool {
        self.parts.contains_key(node)
    }

    /// Who takes part.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.parts.keys().map(String::as_str)
    }

    /// Whether everybody has answered the question.
    #[must_use]
    pub fn is_answered(&self) -> bool {
        self.parts.values().all(|part| self.is_current(part))
    }

    /// Whether, everybody having answered, nobody had anything to do: then nothing more comes of what was said.
    #[must_use]
    pub fn is_quiet(&self) -> bool {
        !self.unsure && self.parts.values().all(|part| self.is_current(part) && part.steps == 0)
    }

    /// When the first node wants to be woken after `now`.
    #[must_use]
    pub fn next_due(&self, now: Time) -> Option<Time> {
        self.parts.values().map(|part| part.due_at).filter(|due_at| *due_at > now).min()
    }

    /// Goes on without those who have not answered; their names.
    pub fn drop_silent(&mut self) -> Vec<String> {
        let silent: Vec<String> = self
            .parts
            .iter()
            .filter(|(_, part)| !self.is_current(part))
            .map(|(name, _)| name.clone())
            .collect();
        self.parts.retain(|name, _| !silent.contains(name));
        silent
    }

    fn is_current(&self, part: &Part) -> bool {
        (part.tick, part.round) == (self.tick, self.round)
    }
}

#[cfg(test)]
mod tests {
    use reflect::Text;

    use super::*;
    use crate::testing::at_ms;

    fn answer(node: &str, tick: u64, round: u32, steps: u64) -> ReplayAnswer {
        ReplayAnswer { node: Text::truncated(node), tick, round, steps, due_at: at_ms(steps as i64) }
    }

    #[test]
    fn it_waits_for_all_who_ever_answered_and_for_silence() {
        let mut step = LockStep::default();
        step.ask(1, 0);
        assert!(step.is_answered() && step.is_quiet(), "nobody to wait for");
        step.take(&answer("estimator", 1, 0, 2));
        step.take(&answer("learner", 0, 9, 0));
        assert!(!step.is_answered(), "an answer to another question is none");
        step.take(&answer("learner", 1, 0, 0));
        assert!(step.is_answered() && !step.is_quiet());
        step.ask(1, 1);
        assert!(!step.is_answered() && !step.is_quiet());
        step.take(&answer("estimator", 1, 1, 0));
        step.take(&answer("learner", 1, 1, 0));
        assert!(step.is_answered() && step.is_quiet());
    }

    #[test]
    fn a_question_asked_again_is_not_believed_to_be_quiet() {
        let mut step = LockStep::default();
        step.ask(1, 0);
        step.take(&answer("estimator", 1, 0, 0));
        step.ask_again();
        assert!(step.is_answered() && !step.is_quiet());
        step.ask(1, 1);
        step.take(&answer("estimator", 1, 1, 3));
        step.take(&answer("estimator", 1, 1, 0));
        assert!(!step.is_quiet(), "its first answer counts too");
    }

    #[test]
    fn it_stops_next_where_the_first_node_is_due() {
        let mut step = LockStep::default();
        assert_eq!(step.next_due(at_ms(0)), None);
        for (node, due) in [("a", 7), ("b", 5), ("c", 3)] {
            step.take(&answer(node, 1, 0, due));
        }
        assert_eq!(step.next_due(at_ms(2)), Some(at_ms(3)));
        assert_eq!(step.next_due(at_ms(3)), Some(at_ms(5)));
        assert_eq!(step.next_due(at_ms(7)), None);
    }

    #[test]
    fn who_falls_silent_is_named_and_waited_for_no_more() {
        let mut step = LockStep::default();
        step.ask(4, 0);
        step.take(&answer("estimator", 4, 0, 0));
        step.take(&answer("learner", 3, 0, 0));
        assert_eq!(step.drop_silent(), ["learner"]);
        assert!(step.is_quiet() && step.count() == 1 && step.has("estimator"));
    }
}
