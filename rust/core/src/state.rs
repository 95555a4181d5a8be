//! Saved states: a version, a checksum, the state.

use alloc::vec::Vec;
use serde::{Serialize, de::DeserializeOwned};

/// The bytes of a state. The last byte of `version` is the version of the layout.
pub fn to_bytes<T: Serialize>(version: [u8; 8], state: &T) -> Vec<u8> {
    let body = postcard::to_allocvec(state).unwrap_or_default();
    let mut bytes = Vec::from(version);
    bytes.extend(crate::checksum(&body).to_le_bytes());
    bytes.extend(body);
    bytes
}

/// The state of such bytes; None where they are of another version, damaged or of something else.
pub fn from_bytes<T: DeserializeOwned>(version: [u8; 8], bytes: &[u8]) -> Option<T> {
    let (checksum, body) = bytes.strip_prefix(&version)?.split_first_chunk::<4>()?;
    (u32::from_le_bytes(*checksum) == crate::checksum(body)).then(|| postcard::from_bytes(body).ok())?
}
