//! A filter as bytes: version, kind, checksum, state.

use alloc::vec::Vec;

use super::{filter::Filter, lane::Real, method::Method};

const VERSION: [u8; 8] = *b"imufQ12\x04";

impl<T: Real, M: Method> Filter<T, M> {
    /// Everything it knows, as bytes: a version, a checksum, the state.
    pub fn to_bytes(&self) -> Vec<u8> {
        let body = postcard::to_allocvec(self).unwrap_or_default();
        let mut bytes = Vec::from(VERSION);
        bytes.push(Self::KIND);
        bytes.extend(crate::checksum(&body).to_le_bytes());
        bytes.extend(body);
        bytes
    }

    /// The filter that [`Self::to_bytes`] wrote; None where the bytes are of another version or kind, damaged or not from there.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (kind, rest) = bytes.strip_prefix(&VERSION)?.split_first()?;
        let (checksum, body) = rest.split_first_chunk::<4>()?;
        if *kind != Self::KIND || u32::from_le_bytes(*checksum) != crate::checksum(body) {
            return None;
        }
        let (filter, rest) = postcard::take_from_bytes::<Self>(body).ok()?;
        (rest.is_empty() && filter.is_sound()).then_some(filter)
    }

    const KIND: u8 = size_of::<T>() as u8 + if M::FULL_COVARIANCE { 128 } else { 0 };
}
