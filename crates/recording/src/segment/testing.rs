//! A disk that fails when told to, and messages to write to it.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use mcap::{MessageStream, Summary};
use quantity::{Span, Time};
use service_core::Observed;
use wire::{Domain, Header, Kind, TopicName};

use super::{Limits, Plan, Storage, StoredFile};
use crate::write::{Compression, WriteOptions};
use crate::{About, Ending};

/// A disk in memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct FakeDisk(Arc<Mutex<Inside>>);

/// What a disk in memory holds, and how it misbehaves.
#[derive(Debug, Default)]
pub(crate) struct Inside {
    pub(crate) files: BTreeMap<PathBuf, Vec<u8>>,
    /// All files together may not be larger.
    pub(crate) capacity: Option<u64>,
    /// After so many more bytes a write fails with this error, once.
    pub(crate) fail_after: Option<(u64, i32)>,
    /// A write takes at most so many bytes.
    pub(crate) short: Option<usize>,
    /// Every other write is interrupted before it began.
    pub(crate) interrupts: bool,
    /// After so many more syncs one fails, once.
    pub(crate) fail_sync_after: Option<u32>,
    /// After so many more renames one fails, once.
    pub(crate) fail_rename_after: Option<u32>,
    pub(crate) free: Option<u64>,
    interrupted: bool,
}

impl FakeDisk {
    pub(crate) fn inside(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap()
    }

    /// The names of all files, in order.
    pub(crate) fn names(&self) -> Vec<String> {
        self.inside().files.keys().map(|path| path.display().to_string()).collect()
    }

    pub(crate) fn file(&self, name: &str) -> Vec<u8> {
        self.inside().files[Path::new(name)].clone()
    }
}

/// A file of it.
#[derive(Debug)]
pub(crate) struct FakeFile {
    disk: FakeDisk,
    /// Names change while a file is open.
    content: Arc<Mutex<PathBuf>>,
}

impl Inside {
    fn used(&self) -> u64 {
        self.files.values().map(|content| content.len() as u64).sum()
    }

    fn room_for(&mut self, wanted: usize) -> io::Result<usize> {
        let mut room = wanted.min(self.short.unwrap_or(usize::MAX));
        if let Some(capacity) = self.capacity {
            room = room.min(capacity.saturating_sub(self.used()) as usize);
            if room == 0 {
                return Err(io::Error::from_raw_os_error(28));
            }
        }
        if let Some((left, errno)) = self.fail_after {
            room = room.min(left as usize);
            if room == 0 {
                self.fail_after = None;
                return Err(io::Error::from_raw_os_error(errno));
            }
            self.fail_after = Some((left - room as u64, errno));
        }
        Ok(room)
    }
}

fn one_fewer(count: &mut Option<u32>) -> io::Result<()> {
    match count {
        Some(0) => {
            *count = None;
            Err(io::Error::from_raw_os_error(5))
        }
        Some(left) => {
            *left -= 1;
            Ok(())
        }
        None => Ok(()),
    }
}

impl Storage for FakeDisk {
    type File = FakeFile;

    fn create_new(&mut self, path: &Path) -> io::Result<FakeFile> {
        let mut inside = self.inside();
        if inside.files.insert(path.to_owned(), Vec::new()).is_some() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        drop(inside);
        Ok(FakeFile { disk: self.clone(), content: Arc::new(Mutex::new(path.to_owned())) })
    }

    fn reserve(&mut self, path: &Path, bytes: u64) -> io::Result<()> {
        let mut inside = self.inside();
        if inside.capacity.is_some_and(|capacity| inside.used() + bytes > capacity) {
            return Err(io::Error::from_raw_os_error(28));
        }
        inside.files.insert(path.to_owned(), vec![0; bytes as usize]);
        Ok(())
    }

    fn rename(&mut self, from: &Path, to: &Path) -> io::Result<()> {
        let mut inside = self.inside();
        one_fewer(&mut inside.fail_rename_after)?;
        assert!(!inside.files.contains_key(to), "{} would be replaced", to.display());
        let content = inside.files.remove(from).unwrap();
        inside.files.insert(to.to_owned(), content);
        Ok(())
    }

    fn remove(&mut self, path: &Path) -> io::Result<()> {
        self.inside().files.remove(path).map(|_| ()).ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn sync_folder(&mut self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn exists(&self, path: &Path) -> bool {
        self.inside().files.contains_key(path)
    }

    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        self.inside().free.ok_or_else(|| io::ErrorKind::Unsupported.into())
    }
}

impl StoredFile for FakeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut inside = self.disk.inside();
        if inside.interrupts {
            inside.interrupted = !inside.interrupted;
            if inside.interrupted {
                return Err(io::ErrorKind::Interrupted.into());
            }
        }
        let count = inside.room_for(bytes.len())?;
        let path = self.content.lock().unwrap().clone();
        inside.files.get_mut(&path).unwrap().extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        let path = self.content.lock().unwrap().clone();
        self.disk.inside().files.get_mut(&path).unwrap().truncate(bytes as usize);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        one_fewer(&mut self.disk.inside().fail_sync_after)
    }
}

/// What a recording is begun with in a test: small chunks, so that there are many.
pub(crate) fn plan(limits: Limits) -> Plan {
    Plan {
        path: "flight.mcap".into(),
        about: about(),
        settings: None,
        options: WriteOptions { compression: Compression::None, chunk_bytes: 4096 },
        limits: Limits { min_free_bytes: 0, ..limits },
    }
}

pub(crate) fn about() -> About {
    About {
        recording: 1,
        segment: 0,
        run: 7,
        domain: Domain::Sim,
        scenario: "double-flip".to_owned(),
        settings_digest: 2,
        started_at: at(0),
        started_wall_ns: 1_000,
        host: "a host".to_owned(),
        revision: String::new(),
    }
}

/// The instant of the message of that number: one each millisecond.
pub(crate) fn at(number: u64) -> Time {
    Time::ZERO + Span::from_secs(10) + Span::from_millis(number as i64)
}

pub(crate) fn header(number: u64) -> Header {
    Header {
        kind: Kind::Data,
        domain: Domain::Sim,
        latched: false,
        source: 3,
        schema_id: 4,
        run: 7,
        incarnation: 5,
        sequence: number,
        published_at: at(number),
    }
}

/// The body of the message of that number: no two are alike, nor of one length.
pub(crate) fn body(number: u64) -> Vec<u8> {
    let length = 20 + (number * 37 % 180) as usize;
    (0..length as u64).map(|index| (number * 131 + index * 7) as u8).collect()
}

/// Hands a message to whatever takes it, as it came from the bus.
pub(crate) fn observed<T>(number: u64, take: impl FnOnce(Time, &Observed<'_>) -> T) -> T {
    let (header, body) = (header(number), body(number));
    let topic = TopicName::new("vehicle/state").unwrap();
    take(at(number), &Observed { header, topic, body: &body, verified: true })
}

/// The numbers of all messages of a file, which has to be whole, each as it was written.
pub(crate) fn numbers_in(file: &[u8]) -> Vec<u64> {
    // Reads the end first: a file without one is refused.
    Summary::read(file).expect("a file with an end");
    MessageStream::new(file)
        .expect("a file with a beginning")
        .map(|message| {
            let message = message.expect("a whole message");
            let number = u64::from(message.sequence);
            assert_eq!(message.channel.topic, "vehicle/state");
            assert_eq!(message.data.as_ref(), body(number));
            assert_eq!(message.log_time, at(number).as_nanos() as u64);
            number
        })
        .collect()
}

/// What a file says of its end.
pub(crate) fn ending_of(file: &[u8]) -> Ending {
    let mut found = None;
    for record in mcap::read::LinearReader::new(file).unwrap() {
        if let mcap::records::Record::Metadata(metadata) = record.unwrap()
            && metadata.name == crate::ENDING_RECORD
        {
            found = Some(Ending::from_metadata(&metadata.metadata).unwrap());
        }
    }
    found.expect("an ending")
}
