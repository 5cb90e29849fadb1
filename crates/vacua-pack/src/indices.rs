//! Lists of indices of N bits each, lowest bits first; native arrays where N is 8, 16 or 32.
//!
//! Source: paper B, §4.2, Table 2 (N from 8 to 32; 16 by default).

/// Bytes after the last index, so that eight bytes can be read at any index.
pub const PADDING: usize = 8;
/// The indices of a sub-mesh start at a multiple of this, hence on a whole byte.
pub const ALIGNMENT: u64 = 8;

/// Appends indices, filled up with zeros to a multiple of [`ALIGNMENT`].
pub fn pack(words: &[u32], bits: u32, out: &mut Vec<u8>) {
    let filled = words.len().next_multiple_of(ALIGNMENT as usize);
    out.reserve(filled * bits as usize / 8);
    if bits == 16 {
        for &word in words {
            out.extend_from_slice(&(word as u16).to_le_bytes());
        }
        out.resize(out.len() + 2 * (filled - words.len()), 0);
        return;
    }
    let (mut pending, mut num_pending) = (0u64, 0);
    let fill = std::iter::repeat_n(&0, filled - words.len());
    for &word in words.iter().chain(fill) {
        pending |= u64::from(word) << num_pending;
        num_pending += bits;
        while num_pending >= 8 {
            out.push(pending as u8);
            pending >>= 8;
            num_pending -= 8;
        }
    }
}

/// Packed indices, of all sub-meshes or of one.
#[derive(Clone, Copy, Debug)]
pub struct IndexList<'a> {
    bytes: &'a [u8],
    bits: u32,
}

impl<'a> IndexList<'a> {
    /// Packed indices, lowest bits first, and eight bytes more.
    pub fn new(bytes: &'a [u8], bits: u32) -> Self {
        Self { bytes, bits }
    }

    /// The list from an index on that is a multiple of 8; empty if it is past the end.
    pub fn from(self, first: u64) -> Self {
        let byte = (first / ALIGNMENT).checked_mul(u64::from(self.bits));
        let bytes = byte
            .and_then(|b| usize::try_from(b).ok())
            .and_then(|b| self.bytes.get(b..));
        Self {
            bytes: bytes.unwrap_or(&[]),
            bits: self.bits,
        }
    }

    /// The bytes, with eight more than the indices take.
    pub fn bytes(self) -> &'a [u8] {
        self.bytes
    }

    /// Number of indices that can be read.
    pub fn len(self) -> u64 {
        (self.bytes.len().saturating_sub(PADDING) as u64) * 8 / u64::from(self.bits)
    }

    /// Whether no index can be read.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Asks for the indices from a place on.
    #[inline(always)]
    pub(crate) fn prefetch(self, place: u32) {
        let byte = u64::from(place) * u64::from(self.bits) / 8;
        vacua_simd::prefetch(self.bytes, usize::try_from(byte).unwrap_or(usize::MAX));
    }

    /// The largest number an index can be, which is the marker where there is one.
    #[inline(always)]
    pub fn largest(self) -> u32 {
        u32::MAX >> (32 - self.bits)
    }

    /// The bytes of so many indices from a place on, if they have 16 bits and the list does not end
    /// before.
    #[inline(always)]
    pub(crate) fn shorts(self, place: u64, len: usize) -> Option<&'a [u8]> {
        let end = place.saturating_add(len as u64);
        (self.bits == 16 && end <= self.len())
            .then(|| &self.bytes[2 * place as usize..2 * end as usize])
    }

    /// Visits so many indices from a place on; none if the list ends before.
    #[inline(always)]
    pub(crate) fn visit(self, place: u64, len: usize, mut visit: impl FnMut(u32)) {
        let end = place.saturating_add(len as u64);
        if end > self.len() {
            return;
        }
        if self.bits == 16 {
            let bytes = &self.bytes[2 * place as usize..2 * end as usize];
            for two in bytes.chunks_exact(2) {
                visit(u32::from(u16::from_le_bytes([two[0], two[1]])));
            }
        } else {
            (place..end).for_each(|place| visit(self.read_bits(place as usize)));
        }
    }

    /// `N` indices from a place on; all are the marker if the list ends before.
    #[inline(always)]
    pub fn read<const N: usize>(self, place: u64) -> [u32; N] {
        let Ok(place) = usize::try_from(place) else {
            return [self.largest(); N];
        };
        if self.bits == 16 {
            let bytes = place
                .checked_mul(2)
                .and_then(|b| self.bytes.get(b..b + 2 * N));
            let Some(bytes) = bytes else {
                return [self.largest(); N];
            };
            return std::array::from_fn(|i| {
                u32::from(u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]))
            });
        }
        std::array::from_fn(|i| self.read_bits(place.saturating_add(i)))
    }

    #[inline]
    fn read_bits(self, place: usize) -> u32 {
        let bit = place as u128 * u128::from(self.bits);
        let eight = usize::try_from(bit / 8)
            .ok()
            .and_then(|byte| self.bytes.get(byte..byte.checked_add(8)?))
            .and_then(|eight| eight.try_into().ok());
        match eight {
            Some(eight) => (u64::from_le_bytes(eight) >> (bit % 8)) as u32 & self.largest(),
            None => self.largest(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn indices_come_back(bits in 8u32..=32, raw in prop::collection::vec(any::<u32>(), 0..100)) {
            let words: Vec<u32> = raw.iter().map(|w| w >> (32 - bits)).collect();
            let mut bytes = Vec::new();
            pack(&words, bits, &mut bytes);
            let second = (words.len() as u64).next_multiple_of(ALIGNMENT);
            pack(&words, bits, &mut bytes);
            bytes.extend([0xFF; PADDING]);
            let list = IndexList::new(&bytes, bits);
            prop_assert_eq!(list.len(), 2 * second);
            for part in [list, list.from(second)] {
                for (i, w) in words.iter().enumerate() {
                    prop_assert_eq!(part.read::<1>(i as u64), [*w]);
                }
                for i in 0..words.len().saturating_sub(4) {
                    prop_assert_eq!(&part.read::<5>(i as u64)[..], &words[i..i + 5]);
                }
            }
            prop_assert_eq!(list.read::<1>(u64::MAX), [list.largest()]);
            prop_assert!(list.from(u64::MAX).is_empty());
        }
    }
}
