//! How to step over a field without reading it.

use std::sync::Arc;

use crate::ViewError;
use crate::view::Cursor;

/// How many bytes a field takes, or how to find out. Consecutive fields of fixed size are one part.
#[derive(Clone, Debug)]
pub(crate) enum Layout {
    /// That many bytes.
    Fixed(u64),
    /// A count of bytes and the bytes.
    Text { bound: u32 },
    /// A count of elements and the elements.
    Seq { element: Arc<Layout>, bound: u32 },
    /// Elements of which at least one part is not of fixed size.
    Array { element: Arc<Layout>, length: u32 },
    /// One after another.
    Parts(Vec<Arc<Layout>>),
}

impl Layout {
    /// The layout of an array.
    pub(crate) fn array(element: Arc<Self>, length: u32) -> Self {
        match *element {
            Self::Fixed(bytes) => Self::Fixed(bytes.saturating_mul(length.into())),
            _ if length == 0 => Self::Fixed(0),
            _ => Self::Array { element, length },
        }
    }

    /// The layout of fields, one after another.
    pub(crate) fn sequence(fields: impl IntoIterator<Item = Arc<Self>>) -> Self {
        let mut parts: Vec<Arc<Self>> = Vec::new();
        for field in fields {
            let merged = match (parts.last().map(|last| &**last), &*field) {
                (Some(Self::Fixed(before)), Self::Fixed(bytes)) => Some(before.saturating_add(*bytes)),
                _ => None,
            };
            match (merged, parts.last_mut()) {
                (Some(bytes), Some(last)) => *last = Arc::new(Self::Fixed(bytes)),
                _ => parts.push(field),
            }
        }
        match parts.as_slice() {
            [] => Self::Fixed(0),
            [only] => Self::clone(only),
            _ => Self::Parts(parts),
        }
    }

    /// Steps over the field. Whatever is not of fixed size takes at least four bytes, so this ends with the
    /// body.
    pub(crate) fn skip(&self, cursor: &mut Cursor<'_>) -> Result<(), ViewError> {
        match self {
            Self::Fixed(bytes) => cursor.skip(*bytes),
            Self::Text { bound } => {
                let count = cursor.count(*bound)?;
                cursor.skip(count.into())
            }
            Self::Seq { element, bound } => {
                let count = cursor.count(*bound)?;
                element.skip_times(count, cursor)
            }
            Self::Array { element, length } => element.skip_times(*length, cursor),
            Self::Parts(parts) => parts.iter().try_for_each(|part| part.skip(cursor)),
        }
    }

    /// Steps over that many of them.
    pub(crate) fn skip_times(&self, times: u32, cursor: &mut Cursor<'_>) -> Result<(), ViewError> {
        match self {
            Self::Fixed(bytes) => cursor.skip(bytes.saturating_mul(times.into())),
            _ => (0..times).try_for_each(|_| self.skip(cursor)),
        }
    }
}
