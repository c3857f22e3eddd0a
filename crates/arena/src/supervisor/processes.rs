//! The processes of a live arena: started, watched, restarted with back-off, ended.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use quantity::{Span, Time};
use tokio::process::{Child, Command};
use tracing::warn;

use super::SupervisorError;

/// Restarts within this span count together.
const RESTART_WINDOW: Span = Span::from_secs(60);
/// After so many restarts in the window a service stays down: it will not come right by itself.
const RESTARTS_MAX: usize = 3;
/// The first restart waits this long, each further one twice as long.
const FIRST_BACK_OFF: Span = Span::from_millis(200);

/// How one process fares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It runs.
    Running,
    /// It ended and will be started again at that instant.
    Waiting(Time),
    /// It ended too often and stays down.
    Down,
}

/// One service as a process of its own.
#[derive(Debug)]
pub struct Supervised {
    service: String,
    child: Option<Child>,
    standing: Standing,
    restarts: Vec<Time>,
    incarnation: u32,
}

/// What every process is started with.
#[derive(Clone, Debug)]
pub struct Launch {
    /// This program.
    pub program: PathBuf,
    /// What the arena's options say, for every service alike.
    pub options: service_shell::Options,
    /// The run.
    pub run: u64,
    /// Seed of the simulator's world, where there is a simulator.
    pub seed: Option<u64>,
    /// Folder for what the services log.
    pub logs: PathBuf,
    /// The logger's own arguments, if there is a logger.
    pub record: Option<Vec<std::ffi::OsString>>,
}

impl Supervised {
    /// Starts a service.
    ///
    /// # Errors
    /// The process cannot be started, or its log cannot be written.
    pub fn start(service: &str, launch: &Launch) -> Result<Self, SupervisorError> {
        Self::start_as(service, service_shell::incarnation_now(), launch)
    }

    /// Starts a service under a given incarnation; a restart has a higher one.
    ///
    /// # Errors
    /// As [`Supervised::start`].
    pub fn start_as(service: &str, incarnation: u32, launch: &Launch) -> Result<Self, SupervisorError> {
        let mut supervised = Self {
            service: service.to_owned(),
            child: None,
            standing: Standing::Running,
            restarts: Vec::new(),
            incarnation,
        };
        supervised.spawn(launch)?;
        Ok(supervised)
    }

    /// The service's name.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// How it fares.
    #[must_use]
    pub fn standing(&self) -> Standing {
        self.standing
    }

    /// The process id while it runs.
    #[must_use]
    pub fn process_id(&self) -> Option<u32> {
        self.child.as_ref().and_then(Child::id)
    }

    /// Looks whether the process has ended, and starts it again when its time has come.
    ///
    /// # Errors
    /// The process cannot be started again.
    pub fn look_after(&mut self, now: Time, launch: &Launch) -> Result<(), SupervisorError> {
        match self.standing {
            Standing::Running => self.notice_end(now),
            Standing::Waiting(at) if at <= now => {
                self.incarnation = service_shell::incarnation_now().max(self.incarnation + 1);
                self.spawn(launch)?;
                self.standing = Standing::Running;
            }
            Standing::Waiting(_) | Standing::Down => {}
        }
        Ok(())
    }

    /// Whether the process has ended by itself.
    pub(super) fn has_ended(&mut self) -> bool {
        self.child.as_mut().is_none_or(|child| !matches!(child.try_wait(), Ok(None)))
    }

    fn notice_end(&mut self, now: Time) {
        let Some(Ok(Some(status))) = self.child.as_mut().map(Child::try_wait) else { return };
        self.child = None;
        self.restarts.retain(|at| now - *at < RESTART_WINDOW);
        if self.restarts.len() >= RESTARTS_MAX {
            warn!(service = self.service, %status, restarts = RESTARTS_MAX, "ended too often and stays down");
            self.standing = Standing::Down;
            return;
        }
        let back_off = FIRST_BACK_OFF * (1 << self.restarts.len());
        warn!(service = self.service, %status, back_off = %back_off, "ended; will be restarted");
        self.restarts.push(now);
        self.standing = Standing::Waiting(now + back_off);
    }

    fn spawn(&mut self, launch: &Launch) -> Result<(), SupervisorError> {
        let log_path = launch.logs.join(format!("{}.log", self.service));
        let log = open_log(&log_path)?;
        let mut command = Command::new(&launch.program);
        command.arg("run").arg(&self.service);
        command.args(launch.options.to_arguments(launch.run, self.incarnation));
        if let (Some(seed), "simulator") = (launch.seed, self.service.as_str()) {
            command.args(["--seed", &seed.to_string()]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        if self.service == logger::NAME {
            command.args(launch.record.iter().flatten());
        }
        // Ctrl-C at the terminal is for the supervisor alone: it lands first.
        command.process_group(0);
        let child = command
            .spawn()
            .map_err(|source| SupervisorError::Process { service: self.service.clone(), source })?;
        self.child = Some(child);
        Ok(())
    }

    /// Asks the process to end.
    pub fn terminate(&mut self) {
        self.standing = Standing::Down;
        let id =
            self.process_id().and_then(|id| i32::try_from(id).ok()).and_then(rustix::process::Pid::from_raw);
        if let Some(id) = id {
            // It may have ended by itself in this very moment, which is what is wanted.
            let _ = rustix::process::kill_process(id, rustix::process::Signal::TERM);
        }
    }

    /// Waits for the process to end, and ends it the hard way if it does not in time.
    pub async fn wait_end(&mut self, patience: std::time::Duration) {
        let Some(child) = self.child.as_mut() else { return };
        if tokio::time::timeout(patience, child.wait()).await.is_err() {
            warn!(service = self.service, "does not end when asked; killed");
            let _ = child.kill().await;
        }
        self.child = None;
    }
}

fn open_log(path: &Path) -> Result<File, SupervisorError> {
    File::options()
        .create(true)
        .append(true)
        .open(path)
        .map_err(|source| SupervisorError::File { path: path.to_owned(), source })
}
