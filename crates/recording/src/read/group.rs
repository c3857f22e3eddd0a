//! Which places of a recording hold wanted messages, in order of time, and which of them must be merged.

use std::ops::Range;

use super::error::ReadError;
use super::merge::Merge;
use super::recording::Recording;
use crate::chunk::{Unpacked, Wanted};
use crate::select::Selection;

/// A place, by its segment and its number in the segment. The order is that of the files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PlaceRef {
    pub segment: u32,
    pub place: u32,
}

/// What a selection means for one recording.
#[derive(Debug)]
pub(crate) struct Plan {
    /// Of each channel of the recording: whether it is wanted.
    channels: Vec<bool>,
    from_ns: i64,
    to_ns: i64,
    /// The places that may hold wanted messages, by their first log time.
    places: Vec<PlaceRef>,
    groups: Vec<Group>,
}

/// Consecutive places of a plan that no other place overlaps in time.
pub(crate) type Group = Range<usize>;

impl Plan {
    pub(crate) fn new(recording: &Recording, selection: &Selection) -> Self {
        let inner = &*recording.inner;
        let channels: Vec<bool> = inner.channels.iter().map(|channel| selection.wants(channel)).collect();
        let (from_ns, to_ns) = selection.bounds_ns();
        let (from, to) = (from_ns.max(0) as u64, to_ns.max(0) as u64);
        let mut places = Vec::new();
        for (number, segment) in inner.segments.iter().enumerate() {
            let numbers = &inner.numbers[number];
            let wanted = |id: &u16| {
                let channel = numbers.get(usize::from(*id)).copied().flatten();
                channel.is_none_or(|channel| channels[channel as usize])
            };
            for (index, place) in segment.places.iter().enumerate() {
                let inside = to_ns >= 0 && place.end >= from && place.start <= to;
                if inside && place.channels.as_ref().is_none_or(|ids| ids.iter().any(wanted)) {
                    let at = PlaceRef { segment: number as u32, place: index as u32 };
                    places.push((place.start, at, place.end));
                }
            }
        }
        places.sort_unstable();
        let groups = group(&places);
        let places = places.into_iter().map(|(_, at, _)| at).collect();
        Self { channels, from_ns, to_ns, places, groups }
    }

    pub(crate) fn groups(&self) -> &[Group] {
        &self.groups
    }

    pub(crate) fn places(&self) -> &[PlaceRef] {
        &self.places
    }

    /// The messages of one group, in order of time.
    pub(crate) fn merge(&self, group: &Group) -> Merge {
        Merge::new(group.clone())
    }

    /// Reads one of the plan's places.
    pub(crate) fn load(
        &self,
        recording: &Recording,
        index: usize,
        buffer: &mut Vec<u8>,
        into: &mut Unpacked,
    ) -> Result<(), ReadError> {
        let at = self.places[index];
        let segment = &recording.inner.segments[at.segment as usize];
        let place = &segment.places[at.place as usize];
        let wanted = Wanted {
            numbers: &recording.inner.numbers[at.segment as usize],
            channels: &self.channels,
            from_ns: self.from_ns,
            to_ns: self.to_ns,
            index: (place.start, place.end),
        };
        segment.load(place, &wanted, buffer, into)
    }
}

/// Where a time begins that none of the places before reaches into, a group begins. Messages of equal time
/// keep the order of the file, so places that only touch need no merging if they stand in the file in that
/// order.
fn group(places: &[(u64, PlaceRef, u64)]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    let mut reach = None;
    for (index, (start, at, end)) in places.iter().enumerate() {
        match (reach, groups.last_mut()) {
            (Some((last, latest)), Some(group)) if *start < last || (*start == last && *at < latest) => {
                group.end = index + 1;
                reach = Some((last.max(*end), latest.max(*at)));
            }
            _ => {
                groups.push(index..index + 1);
                reach = Some((*end, *at));
            }
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(start: u64, place: u32, end: u64) -> (u64, PlaceRef, u64) {
        (start, PlaceRef { segment: 0, place }, end)
    }

    #[test]
    fn only_what_overlaps_is_merged() {
        let apart = [place(0, 0, 5), place(5, 1, 9), place(10, 2, 12)];
        assert_eq!(group(&apart), [0..1, 1..2, 2..3]);
        let across = [place(0, 0, 8), place(2, 1, 3), place(7, 2, 12), place(12, 3, 13)];
        assert_eq!(group(&across), [0..3, 3..4]);
        let touching_in_the_wrong_order = [place(0, 1, 5), place(5, 0, 9)];
        assert_eq!(group(&touching_in_the_wrong_order).len(), 1);
    }
}
