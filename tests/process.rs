//! The front door as a process of its own: what it prints, line by line, and how it is told to end.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Long enough for a crowded machine; a healthy one needs a tenth.
const PATIENCE: Duration = Duration::from_secs(180);

/// A process and what it has printed.
pub struct Process {
    pub child: Child,
    pub heard: Vec<String>,
    pub folder: PathBuf,
    lines: Receiver<String>,
}

impl Process {
    /// Starts a command in a folder.
    pub fn start(folder: PathBuf, mut command: Command) -> Self {
        let mut child = command
            .current_dir(&folder)
            .env_remove("FLYARENA_SECRET_FILE")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        let (sender, lines) = channel();
        let out = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Self { child, heard: Vec::new(), folder, lines }
    }

    /// Waits for a line that satisfies `wanted`.
    pub fn wait_for(&mut self, what: &str, wanted: impl Fn(&str) -> bool) -> String {
        let give_up = Instant::now() + PATIENCE;
        loop {
            match self.lines.recv_timeout(Duration::from_millis(500)) {
                Ok(line) => {
                    self.heard.push(line.clone());
                    if wanted(&line) {
                        return line;
                    }
                }
                Err(RecvTimeoutError::Timeout) if Instant::now() < give_up => {}
                Err(_) => panic!("no {what}; the arena said:\n{}\n{}", self.heard.join("\n"), self.logs()),
            }
        }
    }

    /// What its services have logged.
    fn logs(&self) -> String {
        let mut text = String::new();
        for entry in fs::read_dir(self.folder.join(".flyarena/logs")).into_iter().flatten().flatten() {
            let log = fs::read_to_string(entry.path()).unwrap_or_default();
            text.push_str(&format!("-- {}\n{log}\n", entry.path().display()));
        }
        text
    }

    /// Sends a signal to a process that a test has started.
    pub fn signal(id: u32, name: &str) {
        assert!(
            Command::new("kill").args([&format!("-{name}"), &id.to_string()]).status().unwrap().success()
        );
    }

    /// Tells it to end, as Ctrl-C does.
    pub fn interrupt(&self) {
        Self::signal(self.child.id(), "INT");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Its services end with it, or by themselves soon after.
        if matches!(self.child.try_wait(), Ok(None)) {
            self.interrupt();
            std::thread::sleep(Duration::from_millis(300));
            if matches!(self.child.try_wait(), Ok(None)) {
                self.interrupt();
            }
            let _ = self.child.wait();
        }
    }
}
