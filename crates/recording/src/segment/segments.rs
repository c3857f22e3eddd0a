//! The one writer of a live recording: never fails its caller, loses nothing without counting it.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::path::{Path, PathBuf};

use quantity::{Span, Time};
use schemas::Severity;
use service_core::Observed;
use settings::Arena;
use wire::Kind;

use super::sealable::Sealable;
use super::tail::TAIL_ROOM_BYTES;
use super::{Limits, Storage};
use crate::write::{CHUNK_SPAN, Gap, Loss, Taken, WriteError, WriteOptions, Writer};
use crate::{About, Definition, Ending};

/// [`Segments::tick`] wants to be called this often: a chunk that would become too old before the next call
/// is closed.
const TICK: Span = Span::from_millis(20);
/// The disk is asked to confirm what was written this often.
const SYNC_PERIOD: Span = Span::from_secs(1);
/// How often the disk's free space is looked at.
const SPACE_PERIOD: Span = Span::from_secs(1);
/// Definitions kept, to stand in every segment. Only nodes can announce them.
const DEFINITIONS_MAX: usize = 4096;

/// What a recording is begun with.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The first segment's file; the others have a number before the ending.
    pub path: PathBuf,
    /// What the first segment says of itself.
    pub about: About,
    /// The settings that every segment carries.
    pub settings: Option<Arena>,
    /// How files are written.
    pub options: WriteOptions,
    /// When a segment ends, and what is kept.
    pub limits: Limits,
}

/// Whether a recording goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// A segment is open.
    Recording,
    /// A write failed, the disk is full, or the recording was ended: nothing is recorded any more.
    Stopped,
}

/// Something to tell people, once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// How grave it is.
    pub severity: Severity,
    /// Its name to search for.
    pub name: &'static str,
    /// In a sentence, with the values.
    pub detail: String,
}

/// What became of everything so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Messages that stand in a file, or in the chunk that is open.
    pub recorded: u64,
    /// Definitions taken.
    pub definitions: u64,
    /// Messages dropped because no file took them.
    pub dropped: u64,
    /// Bytes written.
    pub written_bytes: u64,
    /// Segments begun.
    pub segments: u32,
    /// Free bytes on the disk, when last looked at.
    pub free_bytes: u64,
}

struct Open<S: Storage> {
    writer: Writer<Sealable<S::File>>,
    /// The file's name once it is sealed.
    path: PathBuf,
    began_at: Time,
    /// Messages that the disk has confirmed.
    synced: u64,
}

/// A recording in segments.
pub struct Segments<S: Storage> {
    storage: S,
    plan: Plan,
    open: Option<Open<S>>,
    definitions: BTreeMap<u64, Definition>,
    /// The sealed segments that are still there, with their sizes, oldest first.
    sealed: VecDeque<(PathBuf, u64)>,
    notices: Vec<Notice>,
    totals: Totals,
    /// Of the sealed segments.
    sealed_recorded: u64,
    sealed_bytes: u64,
    /// The number of the next segment.
    next: u32,
    /// The last failure was not followed by a success yet: the one attempt at a new segment is used up.
    on_trial: bool,
    sync_at: Time,
    space_at: Time,
    warned_of_space: bool,
    warned_of_room: bool,
    /// What the endings say besides what is known here.
    ending: Ending,
    losses: Vec<Loss>,
}

impl<S: Storage> Segments<S> {
    /// Begins a recording.
    ///
    /// # Errors
    /// A file of that name is there, or the first segment cannot be begun; nothing is left of it then.
    pub fn begin(storage: S, plan: Plan, now: Time) -> Result<Self, WriteError> {
        let mut segments = Self {
            storage,
            plan,
            open: None,
            definitions: BTreeMap::new(),
            sealed: VecDeque::new(),
            notices: Vec::new(),
            totals: Totals::default(),
            sealed_recorded: 0,
            sealed_bytes: 0,
            next: 0,
            on_trial: false,
            sync_at: now + SYNC_PERIOD,
            space_at: now,
            warned_of_space: false,
            warned_of_room: false,
            ending: Ending::default(),
            losses: Vec::new(),
        };
        // Before anything is made or removed: the names may be another recording's.
        segments.refuse_taken(0)?;
        let begun = segments.reserve().and_then(|()| segments.begin_segment(now));
        if let Err(error) = begun {
            segments.release();
            return Err(error);
        }
        segments.watch_space(now);
        Ok(segments)
    }

    /// Whether the recording goes on.
    #[must_use]
    pub fn standing(&self) -> Standing {
        if self.open.is_some() { Standing::Recording } else { Standing::Stopped }
    }

    /// What became of everything so far.
    #[must_use]
    pub fn totals(&self) -> Totals {
        let (messages, bytes) = self
            .open
            .as_ref()
            .map_or((0, 0), |open| (open.writer.messages(), open.writer.sink().good_bytes()));
        Totals {
            recorded: self.sealed_recorded + messages,
            written_bytes: self.sealed_bytes + bytes,
            segments: self.next,
            ..self.totals
        }
    }

    /// The file of the open segment, or else of the last one, as it is named when sealed.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        match &self.open {
            Some(open) => open.path.clone(),
            None => file_of_segment(&self.plan.path, self.next.saturating_sub(1)),
        }
    }

    /// What is to be told since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    /// What the next endings say besides what is known here: what was dropped, refused and lost before it
    /// came here.
    pub fn set_losses(&mut self, ending: Ending, losses: Vec<Loss>) {
        self.ending = ending;
        self.losses = losses;
    }

    /// Takes whatever was heard on the bus. What cannot be recorded is counted.
    pub fn observe(&mut self, now: Time, at: Time, observed: &Observed<'_>) {
        let is_message = matches!(observed.header.kind, Kind::Data | Kind::Journal);
        if observed.header.kind == Kind::Schema {
            self.keep_definition(observed);
        }
        let Some(open) = &mut self.open else {
            self.totals.dropped += u64::from(is_message);
            return;
        };
        match open.writer.observe(at, observed) {
            Ok(Taken::Definition) => self.totals.definitions += 1,
            Ok(Taken::Message | Taken::Neither) => {}
            Err(error @ (WriteError::NoRoom { .. } | WriteError::Time { .. })) => {
                self.totals.dropped += u64::from(is_message);
                self.warn_of_room(&error);
            }
            Err(error) => {
                // It came while the chunk before it could not be written.
                self.totals.dropped += u64::from(is_message);
                self.fail(now, &error);
            }
        }
        self.rotate_if_full(now);
    }

    /// Takes a definition that was announced earlier.
    pub fn define(&mut self, now: Time, definition: &Definition) {
        if self.definitions.len() < DEFINITIONS_MAX {
            self.definitions.entry(definition.id).or_insert_with(|| definition.clone());
        }
        let Some(open) = &mut self.open else { return };
        match open.writer.define(definition) {
            Ok(()) => {}
            Err(error @ (WriteError::NoRoom { .. } | WriteError::Time { .. })) => self.warn_of_room(&error),
            Err(error) => self.fail(now, &error),
        }
    }

    /// Does what is due: closes a chunk that grows old, has the disk confirm, looks at its free space. To be
    /// called every 20 ms.
    pub fn tick(&mut self, now: Time) {
        self.close_chunk_if_old(now);
        if self.space_at <= now {
            self.watch_space(now);
        }
        if self.sync_at <= now {
            self.sync(now);
        }
        self.rotate_if_full(now);
    }

    /// Notes that messages were dropped before they came here.
    pub fn note_gap(&mut self, now: Time, gap: &Gap) {
        if let Some(open) = &mut self.open
            && let Err(error) = open.writer.note_gap(gap)
        {
            self.fail(now, &error);
        }
    }

    /// Ends the recording: the open segment is sealed.
    pub fn finish(&mut self, now: Time, reason: &str) {
        if let Err(error) = self.seal(now, reason) {
            self.on_trial = true;
            self.fail(now, &error);
        }
        self.release();
    }

    fn keep_definition(&mut self, observed: &Observed<'_>) {
        let Some(announced) = observed.definition() else { return };
        if self.definitions.len() < DEFINITIONS_MAX && !self.definitions.contains_key(&announced.id) {
            let (name, text) = (announced.name.to_owned(), announced.text.to_owned());
            self.definitions.insert(announced.id, Definition { id: announced.id, name, text });
        }
    }

    fn close_chunk_if_old(&mut self, now: Time) {
        let Some(open) = &mut self.open else { return };
        if open.writer.chunk_due_at().is_some_and(|due| due <= now + TICK)
            && let Err(error) = open.writer.close_chunk()
        {
            self.fail(now, &error);
        }
    }

    fn sync(&mut self, now: Time) {
        self.sync_at = now + SYNC_PERIOD;
        let Some(open) = &mut self.open else { return };
        match open.writer.sink_mut().sync() {
            Ok(()) => {
                open.synced = open.writer.committed();
                self.on_trial = false;
            }
            Err(error) => self.fail_sync(now, error),
        }
    }

    fn fail_sync(&mut self, now: Time, error: io::Error) {
        self.fail(now, &WriteError::Sink(error));
    }

    fn watch_space(&mut self, now: Time) {
        self.space_at = now + SPACE_PERIOD;
        // A disk that does not tell says soon enough when it is full.
        let Ok(free_bytes) = self.storage.free_bytes(&folder_of(&self.plan.path)) else { return };
        self.totals.free_bytes = free_bytes;
        let Limits { min_free_bytes, .. } = self.plan.limits;
        let warn_free_bytes = self.plan.limits.warn_free_bytes();
        if free_bytes < min_free_bytes {
            let detail = format!(
                "disk full: {free_bytes} bytes free, and {min_free_bytes} are left alone: {} is sealed, and \
                 nothing is recorded any more",
                name_of(&self.file())
            );
            if self.open.is_some() {
                self.finish(now, "disk full");
                self.note(Severity::Fault, "recording-stopped", detail);
            }
        } else if free_bytes < warn_free_bytes {
            if !std::mem::replace(&mut self.warned_of_space, true) {
                let detail =
                    format!("{free_bytes} bytes free: at {min_free_bytes} the recording seals and stops");
                self.note(Severity::Warning, "disk-filling", detail);
            }
        } else {
            self.warned_of_space = false;
        }
    }

    fn rotate_if_full(&mut self, now: Time) {
        let Some(open) = &self.open else { return };
        let Limits { segment_span, segment_bytes, .. } = self.plan.limits;
        let bytes = open.writer.sink().good_bytes() + open.writer.open_chunk_bytes() as u64;
        let is_full = segment_span.is_some_and(|span| now - open.began_at >= span)
            || segment_bytes.is_some_and(|limit| bytes >= limit);
        // A segment holds at least something, however small its limits.
        if !is_full || open.writer.messages() == 0 {
            return;
        }
        if let Err(error) = self.seal(now, "segment full") {
            self.fail(now, &error);
            return;
        }
        self.on_trial = false;
        self.drop_surplus();
        if let Err(error) = self.begin_segment(now) {
            self.stop(&format!("{error}: no further segment can be begun"));
        }
    }

    fn begin_segment(&mut self, now: Time) -> Result<(), WriteError> {
        let number = self.next;
        let path = file_of_segment(&self.plan.path, number);
        let part = part_of(&path);
        self.refuse_taken(number)?;
        let file = self.storage.create_new(&part).map_err(|error| named(error, &part))?;
        let begun = self.begin_file(file, number, now).and_then(|writer| {
            self.storage.sync_folder(&folder_of(&path))?;
            Ok(writer)
        });
        match begun {
            Ok(writer) => {
                self.open = Some(Open { writer, path, began_at: now, synced: 0 });
                self.next = number + 1;
                Ok(())
            }
            Err(error) => {
                // An empty file tells nobody anything.
                let _ = self.storage.remove(&part);
                Err(error)
            }
        }
    }

    fn refuse_taken(&self, segment: u32) -> Result<(), WriteError> {
        let path = file_of_segment(&self.plan.path, segment);
        match [part_of(&path), path].into_iter().find(|path| self.storage.exists(path)) {
            None => Ok(()),
            Some(taken) => {
                let reason = format!("{} is there already", taken.display());
                Err(io::Error::new(io::ErrorKind::AlreadyExists, reason).into())
            }
        }
    }

    fn begin_file(
        &self,
        file: S::File,
        number: u32,
        now: Time,
    ) -> Result<Writer<Sealable<S::File>>, WriteError> {
        let first = &self.plan.about;
        let elapsed_ns = if number == 0 { 0 } else { (now - first.started_at).as_nanos() };
        let about = About {
            segment: number,
            started_at: first.started_at + Span::from_nanos(elapsed_ns),
            started_wall_ns: first.started_wall_ns.saturating_add(elapsed_ns),
            ..first.clone()
        };
        let mut writer =
            Writer::new(Sealable::new(file), self.plan.options, &about, self.plan.settings.as_ref())?;
        for definition in self.definitions.values() {
            writer.define(definition)?;
        }
        writer.close_chunk()?;
        // Whatever fails later, the beginning is there to be sealed.
        writer.sink_mut().sync()?;
        Ok(writer)
    }

    /// Seals the open segment, which stays open if that fails.
    fn seal(&mut self, now: Time, reason: &str) -> Result<(), WriteError> {
        let Some(open) = &mut self.open else { return Ok(()) };
        let ending = Ending {
            stopped_at: now,
            reason: reason.to_owned(),
            recorded: open.writer.messages(),
            dropped_stopped: self.totals.dropped,
            ..self.ending.clone()
        };
        open.writer.seal(&ending, &self.losses)?;
        open.writer.sink_mut().mark_ended();
        open.writer.sink_mut().sync()?;
        let part = part_of(&open.path);
        self.storage.rename(&part, &open.path).map_err(|error| named(error, &open.path))?;
        if let Some(open) = self.open.take() {
            self.count_sealed(open.path, open.writer.messages(), open.writer.sink().good_bytes());
        }
        // The file has its name; only a power cut in this moment could take it away again.
        let _ = self.storage.sync_folder(&folder_of(&self.plan.path));
        Ok(())
    }

    fn count_sealed(&mut self, path: PathBuf, messages: u64, bytes: u64) {
        self.sealed_recorded += messages;
        self.sealed_bytes += bytes;
        self.sealed.push_back((path, bytes));
    }

    /// The open segment has failed: what of it is sound is kept, and another one is tried, once.
    fn fail(&mut self, now: Time, error: &WriteError) {
        let Some(open) = self.open.take() else { return };
        let full = is_disk_full(error);
        let path = open.path.clone();
        let (kept, cut, sealed) = self.seal_torn(now, open, error);
        self.totals.dropped += cut;
        let fate = match sealed {
            Ok(()) => format!("{} is sealed with {kept} messages, {cut} are lost", name_of(&path)),
            Err(error) => {
                format!("{} holds {kept} messages, {cut} are lost; {error}", name_of(&part_of(&path)))
            }
        };
        if full || self.on_trial {
            self.stop(&format!("{error}: {fate}"));
            return;
        }
        self.on_trial = true;
        match self.reserve().and_then(|()| self.begin_segment(now)) {
            Ok(()) => {
                let detail = format!("{error}: {fate}; goes on in {}", name_of(&self.file()));
                self.note(Severity::Warning, "recording-segment-failed", detail);
            }
            Err(next) => self.stop(&format!("{error}: {fate}; no other can be begun: {next}")),
        }
    }

    /// Seals what of a failed segment is sound: messages kept, messages cut off, and whether it worked.
    fn seal_torn(
        &mut self,
        now: Time,
        open: Open<S>,
        error: &WriteError,
    ) -> (u64, u64, Result<(), io::Error>) {
        let Open { writer, path, synced, .. } = open;
        let messages = writer.messages();
        let committed = writer.committed();
        let mut sink = writer.into_sink();
        // After a failed sync the file is only what the disk had confirmed before.
        let kept = if sink.is_cut_to_synced() { synced } else { committed };
        let cut = messages - kept;
        let ending = Ending {
            stopped_at: now,
            reason: error.to_string(),
            recorded: kept,
            dropped_stopped: self.totals.dropped + cut,
            ..self.ending.clone()
        };
        // Its room is needed now.
        self.release();
        let part = part_of(&path);
        let sealed = sink.seal_torn(&ending).and_then(|()| self.storage.rename(&part, &path)).inspect(|()| {
            // As for any other segment.
            let _ = self.storage.sync_folder(&folder_of(&path));
        });
        self.count_sealed(if sealed.is_ok() { path } else { part }, kept, sink.good_bytes());
        (kept, cut, sealed)
    }

    fn stop(&mut self, why: &str) {
        self.release();
        self.note(Severity::Fault, "recording-stopped", why.to_owned());
    }

    fn drop_surplus(&mut self) {
        let sizes: Vec<u64> = self.sealed.iter().map(|(_, bytes)| *bytes).collect();
        for (path, _) in self.sealed.drain(..self.plan.limits.surplus(&sizes)) {
            // Whoever took it away before has done what was wanted.
            let _ = self.storage.remove(&path);
        }
    }

    fn reserve(&mut self) -> Result<(), WriteError> {
        let path = reserve_of(&self.plan.path);
        self.storage.reserve(&path, TAIL_ROOM_BYTES).map_err(|error| named(error, &path).into())
    }

    fn release(&mut self) {
        // It is only room; without it, sealing on a full disk may fail and says so.
        let _ = self.storage.remove(&reserve_of(&self.plan.path));
    }

    fn warn_of_room(&mut self, error: &WriteError) {
        if !std::mem::replace(&mut self.warned_of_room, true) {
            let detail = format!("{error}; such messages are counted as dropped");
            self.note(Severity::Warning, "recording-refuses", detail);
        }
    }

    fn note(&mut self, severity: Severity, name: &'static str, detail: String) {
        self.notices.push(Notice { severity, name, detail });
    }
}

/// Whether no other file of this disk will fare better.
fn is_disk_full(error: &WriteError) -> bool {
    matches!(error, WriteError::Sink(error)
        if matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded))
}

fn named(error: io::Error, path: &Path) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// The file of a segment of the recording whose first is `path`: `stem.mcap`, `stem.0001.mcap`, …
#[must_use]
pub fn file_of_segment(path: &Path, segment: u32) -> PathBuf {
    if segment == 0 {
        return path.to_owned();
    }
    let name = name_of(path);
    let stem = name.strip_suffix(".mcap").unwrap_or(&name);
    path.with_file_name(format!("{stem}.{segment:04}.mcap"))
}

/// The name of a segment's file while it is open.
#[must_use]
pub fn part_of(path: &Path) -> PathBuf {
    path.with_file_name(format!("{}.part", name_of(path)))
}

fn reserve_of(path: &Path) -> PathBuf {
    path.with_file_name(format!("{}.reserve", name_of(path)))
}

const _: () = assert!(TICK.as_nanos() < CHUNK_SPAN.as_nanos(), "a chunk could not be closed in time");
