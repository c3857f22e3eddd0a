//! `arena health`: whether a service makes progress, by its own account on the bus.

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use schemas::{NodeHealth, topics};
use service_core::Observer;
use service_shell::{BusReceiver, Listen, Options, Setup, ShellError};

use super::Failure;

/// Every node tells of itself once a second: two accounts and some patience.
const DEFAULT_PATIENCE_S: u64 = 4;

/// Options of `arena health`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The service; none asks only whether there is a run to join: settings, a secret and a run's id
    service: Option<String>,
    /// It may have nothing to do: what it says of itself is progress enough. A bridge makes steps only while its device
    /// sends
    #[arg(long)]
    may_idle: bool,
    /// How long to listen
    #[arg(long, value_name = "SECONDS", default_value_t = DEFAULT_PATIENCE_S,
        value_parser = clap::value_parser!(u64).range(1..=3600))]
    patience: u64,
    #[command(flatten)]
    options: Options,
}

/// Runs the command: exit code 0 where the service's count of steps (of messages, if it may idle) rises, 1 where it does
/// not.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    service_shell::init_logging(&arguments.options.log);
    let setup = Setup::load("arena", &arguments.options.joining())?;
    let Some(service) = &arguments.service else {
        return Ok(ExitCode::SUCCESS);
    };
    let mut progress = Progress::new(arguments.may_idle);
    let patience = Duration::from_secs(arguments.patience);
    let listened = service_shell::block_on(async {
        let listening = listen(&setup, service, &mut progress);
        Ok(tokio::time::timeout(patience, listening).await.unwrap_or(Ok(())))
    })?;
    listened?;
    if progress.made {
        return Ok(ExitCode::SUCCESS);
    }
    match progress.last {
        None => eprintln!("{service}: not heard for {} s", arguments.patience),
        Some(health) => {
            eprintln!("{service}: no progress, at {} steps and {} messages", health.steps, health.published);
        }
    }
    Ok(ExitCode::FAILURE)
}

/// What a node's accounts of itself come to.
#[derive(Debug, Default)]
struct Progress {
    may_idle: bool,
    last: Option<NodeHealth>,
    made: bool,
}

impl Progress {
    fn new(may_idle: bool) -> Self {
        Self { may_idle, ..Self::default() }
    }

    /// A count compares only with an earlier one of the same start.
    fn note(&mut self, health: NodeHealth) {
        self.made |= self.last.as_ref().is_some_and(|last| {
            let works = last.steps < health.steps || (self.may_idle && last.published < health.published);
            last.started_at == health.started_at && works
        });
        self.last = Some(health);
    }
}

async fn listen(setup: &Setup, service: &str, progress: &mut Progress) -> Result<(), ShellError> {
    let (network, domain) = (&setup.arena.network, setup.identity.domain);
    let mut receiver = BusReceiver::join(network, domain, Listen::Topics(&[&topics::NODE_HEALTH]))?;
    let mut observer = Observer::new(&setup.secret, domain, setup.identity.run);
    while !progress.made {
        for index in 0..receiver.next_batch().await? {
            // What is not authentic is nobody's account.
            let Ok(observed) = observer.observe(receiver.datagram(index).bytes) else { continue };
            let Ok(health) = service_core::decode::<NodeHealth>(observed.body) else { continue };
            if observed.verified && health.node.as_str() == service {
                progress.note(health);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use quantity::{Span, Time};

    use super::*;

    fn account(start_s: i64, steps: u64) -> NodeHealth {
        NodeHealth { started_at: Time::ZERO + Span::from_secs(start_s), steps, ..NodeHealth::default() }
    }

    fn idle(start_s: i64, published: u64) -> NodeHealth {
        NodeHealth { published, ..account(start_s, 1) }
    }

    fn made(mut progress: Progress, accounts: &[NodeHealth]) -> bool {
        accounts.iter().cloned().for_each(|account| progress.note(account));
        progress.made
    }

    fn progress(accounts: &[NodeHealth]) -> bool {
        made(Progress::new(false), accounts)
    }

    #[test]
    fn progress_is_a_count_that_rises_within_one_life() {
        assert!(progress(&[account(1, 10), account(1, 11)]));
        assert!(!progress(&[]) && !progress(&[account(1, 10)]), "one account compares with nothing");
        assert!(!progress(&[account(1, 10), account(1, 10)]), "it hangs");
        assert!(!progress(&[account(1, 10), account(2, 11)]), "it was started again");
        assert!(progress(&[account(1, 10), account(2, 3), account(2, 4)]));
    }

    #[test]
    fn whoever_may_idle_makes_progress_by_what_it_says() {
        let progress = |accounts: &[NodeHealth]| made(Progress::new(true), accounts);
        assert!(progress(&[idle(1, 10), idle(1, 11)]));
        assert!(!progress(&[idle(1, 10)]) && !progress(&[idle(1, 10), idle(1, 10)]), "it says nothing new");
        assert!(!progress(&[idle(1, 10), idle(2, 11)]), "it was started again");
        assert!(!made(Progress::new(false), &[idle(1, 10), idle(1, 11)]), "others have steps to make");
    }
}
