//! What program this is: by its digest the programs of two arenas are compared.

use std::sync::OnceLock;

use tracing::warn;
use twox_hash::XxHash3_64;

/// XXH3-64 of this program's file; zero, with a warning, where it cannot be read.
#[must_use]
pub fn program_digest() -> u64 {
    static DIGEST: OnceLock<u64> = OnceLock::new();
    *DIGEST.get_or_init(|| match std::fs::read("/proc/self/exe") {
        Ok(bytes) => XxHash3_64::oneshot(&bytes),
        Err(error) => {
            warn!(%error, "this program's own file cannot be read: its digest is announced as zero");
            0
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_the_file() {
        let file = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        assert_eq!(program_digest(), XxHash3_64::oneshot(&file));
    }
}
