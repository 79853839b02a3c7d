//! Tokens and their hashes. A token is 32 random bytes, so a plain SHA-256 of it cannot be guessed
//! backwards, and no slow password hash is needed.

use rand::TryRngCore as _;
use rand::rngs::OsRng;
use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;

/// Before the digits of a token, so that scanners for secrets find it.
const PREFIX: &str = "lexsplat_";
const BYTES: usize = 32;
/// Before the digits of a hash in the tokens file.
const HASH_PREFIX: &str = "sha256:";

/// The hash of a token.
#[derive(Clone, Copy, Debug)]
pub(super) struct TokenHash([u8; 32]);

impl TokenHash {
    pub(super) fn of(token: &str) -> Self {
        Self(Sha256::digest(token).into())
    }

    /// Compares in constant time.
    pub(super) fn is(&self, other: &Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }

    /// Reads `sha256:` and 64 hexadecimal digits; `None` for anything else.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let digits = text.strip_prefix(HASH_PREFIX)?;
        if digits.len() != 64 || !digits.is_ascii() {
            return None;
        }
        let mut hash = [0; 32];
        for (byte, pair) in hash.iter_mut().zip(digits.as_bytes().chunks(2)) {
            let pair = std::str::from_utf8(pair).ok()?;
            *byte = u8::from_str_radix(pair, 16).ok()?;
        }
        Some(Self(hash))
    }

    /// What [`Self::parse`] reads.
    pub(super) fn to_text(self) -> String {
        format!("{HASH_PREFIX}{}", hexadecimal(&self.0))
    }
}

/// A new token from the system's random numbers.
///
/// # Errors
/// If the system has none.
pub(super) fn new_token() -> Result<String, String> {
    let mut bytes = [0; BYTES];
    OsRng.try_fill_bytes(&mut bytes).map_err(|error| error.to_string())?;
    Ok(format!("{PREFIX}{}", hexadecimal(&bytes)))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_written_and_read_back() {
        let token = new_token().unwrap();
        assert_ne!(token, new_token().unwrap());
        assert!(token.len() == PREFIX.len() + 2 * BYTES, "{token}");
        let hash = TokenHash::of(&token);
        let text = hash.to_text();
        assert!(TokenHash::parse(&text).unwrap().is(&hash));
        assert!(!TokenHash::parse(&text).unwrap().is(&TokenHash::of("other")));
        assert!(!text.contains(&token));
    }

    #[test]
    fn hashes_are_the_standard_ones() {
        let abc = "sha256:ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(TokenHash::of("abc").to_text(), abc);
        for wrong in
            ["", "sha256:", "sha256:00", &abc[7..], &abc.replace('b', "g"), &abc.replace("cb", "é")]
        {
            assert!(TokenHash::parse(wrong).is_none(), "{wrong}");
        }
    }
}
