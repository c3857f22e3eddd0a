use reflect::Enumeration;

/// No size.
#[derive(Clone, Copy, Enumeration)]
enum Sizeless {
    /// A value.
    One = 1,
}

/// No value.
#[derive(Clone, Copy, Enumeration)]
#[repr(u8)]
enum Valueless {
    /// A value.
    One,
}

/// No doc comment.
#[derive(Clone, Copy, Enumeration)]
#[repr(u8)]
enum Undocumented {
    One = 1,
}

/// More than fits.
#[derive(Clone, Copy, Enumeration)]
#[repr(u8)]
enum Large {
    /// A value.
    One = 256,
}

fn main() {}
