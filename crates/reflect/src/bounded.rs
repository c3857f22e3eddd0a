//! Text and sequences with a bound, written as ROS 1 writes them: a `u32` count, then the content.
//!
//! bincode's own text and vectors have a `u64` count and no bound. Here both are written as tuples of a count
//! and elements, which is what a count and elements are to any format that writes fields one after another.
//! They are made for such formats only: a body is read without its Rust type through [`Value`](crate::Value).

use core::fmt;
use core::marker::PhantomData;
use core::ops::Deref;

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{FieldType, Kind};

/// Content that exceeds the bound of its [`Text`] or [`Seq`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong {
    /// Bytes or elements there were.
    pub length: usize,
    /// Bytes or elements there may be.
    pub bound: usize,
}

impl fmt::Display for TooLong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "length {} exceeds the bound {}", self.length, self.bound)
    }
}

impl core::error::Error for TooLong {}

/// UTF-8 text of at most `N` bytes, held in place.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Text<const N: usize> {
    // Bytes past the length stay zero, so that derived comparison is that of the texts.
    bytes: [u8; N],
    length: u32,
}

impl<const N: usize> Text<N> {
    /// No text.
    pub const EMPTY: Self = Self { bytes: [0; N], length: 0 };

    /// Whatever `content` displays as, cut at the last character that fits. Takes `&str`, `format_args!` and
    /// any other `Display`; allocates nothing.
    #[must_use]
    pub fn truncated(content: impl fmt::Display) -> Self {
        let mut writer = Truncating { text: Self::EMPTY, full: false };
        // An error stands for "full", or comes from `content` itself; either way what was written stands.
        let _ = fmt::write(&mut writer, format_args!("{content}"));
        writer.text
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        core::str::from_utf8(&self.bytes[..self.length as usize])
            .expect("only whole characters are ever stored")
    }
}

struct Truncating<const N: usize> {
    text: Text<N>,
    full: bool,
}

impl<const N: usize> fmt::Write for Truncating<N> {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        if self.full {
            return Err(fmt::Error);
        }
        let start = self.text.length as usize;
        let taken = part.floor_char_boundary(N - start);
        self.text.bytes[start..start + taken].copy_from_slice(&part.as_bytes()[..taken]);
        self.text.length += taken as u32;
        self.full = taken < part.len();
        if self.full { Err(fmt::Error) } else { Ok(()) }
    }
}

impl<const N: usize> Default for Text<N> {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl<const N: usize> Deref for Text<N> {
    type Target = str;
    fn deref(&self) -> &str {
        self.as_str()
    }
}

impl<const N: usize> AsRef<str> for Text<N> {
    fn as_ref(&self) -> &str {
        self.as_str()
    }
}

impl<const N: usize> PartialEq<str> for Text<N> {
    fn eq(&self, other: &str) -> bool {
        self.as_str() == other
    }
}

impl<const N: usize> PartialEq<&str> for Text<N> {
    fn eq(&self, other: &&str) -> bool {
        self.as_str() == *other
    }
}

impl<const N: usize> fmt::Display for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl<const N: usize> TryFrom<&str> for Text<N> {
    type Error = TooLong;

    fn try_from(content: &str) -> Result<Self, TooLong> {
        let mut text = Self::EMPTY;
        text.bytes
            .get_mut(..content.len())
            .ok_or(TooLong { length: content.len(), bound: N })?
            .copy_from_slice(content.as_bytes());
        text.length = content.len() as u32;
        Ok(text)
    }
}

impl<const N: usize> FieldType for Text<N> {
    const KIND: Kind = Kind::Text { bound: N as u32 };
}

impl<const N: usize> Serialize for Text<N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(1 + self.length as usize)?;
        tuple.serialize_element(&self.length)?;
        serialize_bytes(&self.bytes[..self.length as usize], &mut tuple)?;
        tuple.end()
    }
}

impl<'de, const N: usize> Deserialize<'de> for Text<N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TextVisitor<const N: usize>;

        impl<'de, const N: usize> Visitor<'de> for TextVisitor<N> {
            type Value = Text<N>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "text of at most {N} bytes")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Text<N>, A::Error> {
                let count = read_count(&mut access, N)?;
                let mut text = Text { bytes: [0; N], length: count as u32 };
                deserialize_bytes(&mut text.bytes[..count], &mut access)?;
                core::str::from_utf8(&text.bytes[..count]).map_err(A::Error::custom)?;
                Ok(text)
            }
        }

        deserializer.deserialize_tuple(1 + N, TextVisitor)
    }
}

/// At most `N` elements; a slice once it is made.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Seq<T, const N: usize>(Vec<T>);

impl<T, const N: usize> Seq<T, N> {
    /// No elements.
    pub const EMPTY: Self = Self(Vec::new());

    /// Appends an element; refused, and returned, when `N` are there.
    ///
    /// # Errors
    /// The element itself, if it does not fit.
    pub fn push(&mut self, element: T) -> Result<(), T> {
        if self.0.len() == N {
            return Err(element);
        }
        self.0.push(element);
        Ok(())
    }
}

impl<T: Clone, const N: usize> TryFrom<&[T]> for Seq<T, N> {
    type Error = TooLong;

    fn try_from(elements: &[T]) -> Result<Self, TooLong> {
        if elements.len() > N {
            return Err(TooLong { length: elements.len(), bound: N });
        }
        Ok(Self(elements.to_vec()))
    }
}

impl<T, const N: usize> TryFrom<Vec<T>> for Seq<T, N> {
    type Error = TooLong;

    fn try_from(elements: Vec<T>) -> Result<Self, TooLong> {
        if elements.len() > N {
            return Err(TooLong { length: elements.len(), bound: N });
        }
        Ok(Self(elements))
    }
}

impl<T, const N: usize> Default for Seq<T, N> {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl<T, const N: usize> Deref for Seq<T, N> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<'a, T, const N: usize> IntoIterator for &'a Seq<T, N> {
    type Item = &'a T;
    type IntoIter = core::slice::Iter<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<T: FieldType, const N: usize> FieldType for Seq<T, N> {
    const KIND: Kind = Kind::Seq { element: &T::KIND, bound: N as u32 };
    const NEEDS_UNIT: bool = T::NEEDS_UNIT;
    const AXES: Option<crate::Axes> = T::AXES;

    fn all_finite(&self) -> bool {
        self.0.iter().all(FieldType::all_finite)
    }
}

impl<T: FieldType + Serialize, const N: usize> Serialize for Seq<T, N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(1 + self.0.len())?;
        tuple.serialize_element(&(self.0.len() as u32))?;
        T::serialize_all(&self.0, &mut tuple)?;
        tuple.end()
    }
}

impl<'de, T: FieldType + Deserialize<'de>, const N: usize> Deserialize<'de> for Seq<T, N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct SeqVisitor<T, const N: usize>(PhantomData<T>);

        impl<'de, T: FieldType + Deserialize<'de>, const N: usize> Visitor<'de> for SeqVisitor<T, N> {
            type Value = Seq<T, N>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "at most {N} elements")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Seq<T, N>, A::Error> {
                let count = read_count(&mut access, N)?;
                T::deserialize_all(&mut access, count).map(Seq)
            }
        }

        deserializer.deserialize_tuple(1 + N, SeqVisitor(PhantomData))
    }
}

fn read_count<'de, A: SeqAccess<'de>>(access: &mut A, bound: usize) -> Result<usize, A::Error> {
    let count: u32 = next(access)?;
    let length = count as usize;
    if length > bound { Err(A::Error::custom(TooLong { length, bound })) } else { Ok(length) }
}

fn next<'de, A: SeqAccess<'de>, T: Deserialize<'de>>(access: &mut A) -> Result<T, A::Error> {
    access.next_element()?.ok_or_else(|| A::Error::custom("content cut short"))
}

/// Bytes as little-endian `u64` words and a rest: the same bytes on a little-endian wire of fixed sizes, at a
/// fraction of the calls.
pub(crate) fn serialize_bytes<S: SerializeTuple>(bytes: &[u8], tuple: &mut S) -> Result<(), S::Error> {
    let (words, rest) = bytes.as_chunks::<8>();
    words.iter().try_for_each(|word| tuple.serialize_element(&u64::from_le_bytes(*word)))?;
    rest.iter().try_for_each(|byte| tuple.serialize_element(byte))
}

/// The reverse of [`serialize_bytes`]; fills all of `bytes`.
pub(crate) fn deserialize_bytes<'de, A: SeqAccess<'de>>(
    bytes: &mut [u8],
    access: &mut A,
) -> Result<(), A::Error> {
    let (words, rest) = bytes.as_chunks_mut::<8>();
    for word in words {
        *word = next::<_, u64>(access)?.to_le_bytes();
    }
    for byte in rest {
        *byte = next(access)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn text_is_cut_between_characters() {
        assert_eq!(Text::<4>::truncated("aéé"), "aé");
        assert_eq!(Text::<4>::truncated("ab").as_str(), "ab");
        assert_eq!(Text::<4>::truncated(format_args!("{}{}é{}", "a", 12, "never reached")), "a12");
        assert_eq!(Text::<0>::truncated("a"), "");
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert_eq!(Text::<4>::try_from("12345"), Err(TooLong { length: 5, bound: 4 }));
        assert_eq!(Seq::<u8, 2>::try_from(vec![1, 2, 3]), Err(TooLong { length: 3, bound: 2 }));
        assert_eq!(Seq::<u8, 2>::try_from(&[1, 2, 3][..]), Err(TooLong { length: 3, bound: 2 }));
        let mut full = Seq::<u8, 1>::try_from(vec![1]).expect("one fits");
        assert_eq!(full.push(2), Err(2));
        assert_eq!(*full, [1]);
    }

    proptest! {
        #[test]
        fn text_orders_and_equals_as_its_content_does(a in "\\PC{0,4}", b in "\\PC{0,4}") {
            let (x, y) = (Text::<16>::truncated(&a), Text::<16>::truncated(&b));
            prop_assert_eq!(x == y, a == b);
            prop_assert_eq!(x.cmp(&y), a.cmp(&b));
            prop_assert_eq!(Text::<16>::try_from(a.as_str()), Ok(x));
        }

        #[test]
        fn truncated_text_is_the_longest_that_fits(content in "\\PC{0,12}") {
            let text = Text::<8>::truncated(&content);
            prop_assert!(content.starts_with(text.as_str()));
            let next = content[text.len()..].chars().next();
            prop_assert!(next.is_none_or(|next| text.len() + next.len_utf8() > 8));
        }
    }
}
