//! What the unit tests of playback share.

use quantity::{Span, Time};
use recording::Stream;
use wire::{Domain, Kind};

/// Where the recordings of the tests begin.
pub(crate) const BEGIN: Time = Time::from_nanos(5_000_000_000_000);

pub(crate) fn at_ms(milliseconds: i64) -> Time {
    BEGIN + Span::from_millis(milliseconds)
}

pub(crate) fn stream(topic: &str, source: u32) -> Stream {
    Stream {
        topic: topic.to_owned(),
        kind: Kind::Data,
        source,
        incarnation: 3,
        domain: Domain::Live,
        run: 9,
        schema_id: 77,
        latched: false,
        verified: true,
    }
}
