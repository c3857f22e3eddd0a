//! The two macros that write down a service's whole contract with the bus.

/// Declares the closed enum of topics a core consumes.
///
/// ```
/// service_core::inputs! {
///     /// What this service hears.
///     pub enum Input {
///         /// Poses.
///         Mocap(schemas::MocapFrame) = schemas::topics::MOCAP_FRAME,
///     }
/// }
/// ```
#[macro_export]
macro_rules! inputs {
    ($(#[$meta:meta])* $visibility:vis enum $name:ident {
        $($(#[$doc:meta])* $variant:ident($message:ty) = $topic:path,)*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        #[allow(clippy::large_enum_variant, reason = "inputs are stepped on once, never stored in bulk")]
        $visibility enum $name { $($(#[$doc])* $variant($message),)* }

        impl $crate::Inbound for $name {
            fn topics() -> &'static [&'static $crate::Topic] {
                static TOPICS: &[&$crate::Topic] = &[$(&$topic),*];
                TOPICS
            }

            fn decode(index: usize, body: &[u8]) -> Result<Self, $crate::DecodeError> {
                const DECODERS: &[fn(&[u8]) -> Result<$name, $crate::DecodeError>] =
                    &[$(|body| $crate::decode::<$message>(body).map($name::$variant)),*];
                DECODERS[index](body)
            }
        }

        $(impl From<$message> for $name {
            fn from(message: $message) -> Self { Self::$variant(message) }
        })*
    };
}

/// Declares the closed enum of topics a core produces.
///
/// ```
/// service_core::outputs! {
///     /// What this service says.
///     pub enum Output {
///         /// Estimates.
///         State(schemas::VehicleState) = schemas::topics::VEHICLE_STATE,
///     }
/// }
/// ```
#[macro_export]
macro_rules! outputs {
    ($(#[$meta:meta])* $visibility:vis enum $name:ident {
        $($(#[$doc:meta])* $variant:ident($message:ty) = $topic:path,)*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        #[allow(clippy::large_enum_variant, reason = "outputs are encoded at once, never stored in bulk")]
        $visibility enum $name { $($(#[$doc])* $variant($message),)* }

        impl $crate::Outbound for $name {
            fn topics() -> &'static [&'static $crate::Topic] {
                static TOPICS: &[&$crate::Topic] = &[$(&$topic),*];
                TOPICS
            }

            fn topic(&self) -> &'static $crate::Topic {
                match *self { $(Self::$variant(_) => &$topic,)* }
            }

            fn encode(&self, body: &mut Vec<u8>) -> Result<(), $crate::EncodeError> {
                match *self { $(Self::$variant(ref message) => $crate::encode(message, body),)* }
            }
        }

        $(impl From<$message> for $name {
            fn from(message: $message) -> Self { Self::$variant(message) }
        })*
    };
}
