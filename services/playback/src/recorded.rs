//! A recording on disk as a source.

use std::path::Path;

use quantity::Time;
use recording::{Recording, Selection, Stream};
use service_core::source_of;
use settings::Arena;
use tracing::warn;
use wire::{Domain, Kind};

use crate::source::{Channel, Kept, Message, Source, SourceError, Take};

/// A recording on disk: a file, and the segments that follow it.
#[derive(Clone, Debug)]
pub struct Recorded {
    recording: Recording,
    channels: Vec<Channel>,
    damaged: u64,
}

impl Recorded {
    /// Opens a recording.
    ///
    /// # Errors
    /// A file that cannot be read, or is no recording.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        Recording::open(path).map(Self::of).map_err(|error| SourceError(error.to_string()))
    }

    /// A recording that is open.
    #[must_use]
    pub fn of(recording: Recording) -> Self {
        for damage in recording.damage() {
            warn!("{damage}; playing what can be read");
        }
        let channels = recording.channels().iter().map(channel_of).collect();
        Self { recording, channels, damaged: 0 }
    }

    /// The settings that the arena ran with, if they are attached.
    ///
    /// # Errors
    /// Settings that are damaged.
    pub fn settings(&self) -> Result<Option<Arena>, SourceError> {
        self.recording.settings().map_err(|error| SourceError(error.to_string()))
    }

    /// The first recorded incarnation of a service.
    #[must_use]
    pub fn incarnation_of(&self, service: &str) -> Option<u32> {
        let own = self.channels.iter().filter(|channel| channel.stream.source == source_of(service));
        own.map(|channel| channel.stream.incarnation).min()
    }

    fn selection(&self, wanted: &[bool]) -> Selection {
        let channels = self.recording.channels().iter().zip(wanted);
        Selection::of_channels(channels.filter(|(_, wanted)| **wanted).map(|(channel, _)| channel.id))
    }
}

/// A channel of a file that no recorder of ours wrote is played all the same, unverified.
fn channel_of(channel: &recording::Channel) -> Channel {
    let foreign = || Stream {
        topic: channel.topic.clone(),
        kind: Kind::Data,
        source: channel.id,
        incarnation: 0,
        domain: Domain::Replay,
        run: 0,
        schema_id: channel.definition.as_ref().map_or(0, |definition| definition.id),
        latched: false,
        verified: false,
    };
    let stream = channel.stream.clone().unwrap_or_else(foreign);
    Channel { stream, definition: channel.definition.clone() }
}

impl Source for Recorded {
    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn time_range(&self) -> Option<(Time, Time)> {
        self.recording.time_range()
    }

    fn origin(&self) -> Option<Time> {
        Some(self.recording.started_at())
    }

    fn latched_before(&mut self, before: Time, wanted: &[bool]) -> Result<Vec<Kept>, SourceError> {
        let latched = self.recording.latched_before(before, &self.selection(wanted));
        let latched = latched.map_err(|error| SourceError(error.to_string()))?;
        let kept = latched.into_iter().map(|kept| Kept {
            channel: kept.channel as usize,
            sequence: kept.sequence,
            at: kept.at,
            published_at: kept.published_at,
            body: kept.body,
        });
        Ok(kept.collect())
    }

    fn read(
        &mut self,
        from: Time,
        to: Time,
        wanted: &[bool],
        take: &mut Take<'_>,
    ) -> Result<(), SourceError> {
        let mut messages = self.recording.messages(&self.selection(wanted).from(from).to(to));
        while let Some(message) = messages.next() {
            let message = match message {
                Ok(message) => message,
                // What is damaged is missing; what comes after it is not.
                Err(error) => {
                    self.damaged += 1;
                    if self.damaged.is_power_of_two() {
                        warn!("{error}; playing on after it");
                    }
                    continue;
                }
            };
            let taken = take(Message {
                channel: message.channel.id as usize,
                sequence: message.sequence,
                at: message.at,
                published_at: message.published_at,
                body: message.body,
            });
            if taken.is_break() {
                break;
            }
        }
        Ok(())
    }
}
