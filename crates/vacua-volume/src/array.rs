//! Typed arrays over shared bytes: a `Vec`, or a piece of a memory-mapped file, without a copy.
//!
//! A [`DataArray`] is `tuples × components` numbers of one [`ScalarType`], components interleaved,
//! in native byte order and aligned for their type. It is cheap to clone: the bytes are shared.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use crate::scalar::{Scalar, ScalarType};
use crate::{ValueRange, dispatch_scalar};

/// Memory that outlives the arrays over it and does not move or change: a `Vec`, a file mapping.
pub trait ByteStore: Send + Sync {
    /// The bytes. Every call returns the same address and contents.
    fn bytes(&self) -> &[u8];

    /// Says that a range of the bytes is not asked for again soon. What lies in a file need not stay in
    /// memory then; it is read again if it is asked for after all.
    fn release(&self, _range_bytes: Range<usize>) {}
}

impl ByteStore for Vec<u8> {
    fn bytes(&self) -> &[u8] {
        self
    }
}

/// A typed `Vec` as a byte store; the allocation keeps the alignment of its type.
struct TypedStore<T>(Vec<T>);

impl<T: Scalar> ByteStore for TypedStore<T> {
    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

/// Why bytes are not the array they are said to be.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum ArrayError {
    /// The store ends before the array does.
    #[error(
        "an array of {tuples} × {components} {scalar_type} needs bytes {offset}..{end}, only {available} are there"
    )]
    OutOfBounds {
        /// Number of tuples asked for.
        tuples: usize,
        /// Components a tuple.
        components: usize,
        /// Type of a number.
        scalar_type: ScalarType,
        /// First byte.
        offset: usize,
        /// One past the last byte.
        end: usize,
        /// Length of the store in bytes.
        available: usize,
    },
    /// `tuples × components × size` does not fit the address space.
    #[error("an array of {tuples} × {components} {scalar_type} is larger than the address space")]
    TooLarge {
        /// Number of tuples asked for.
        tuples: usize,
        /// Components a tuple.
        components: usize,
        /// Type of a number.
        scalar_type: ScalarType,
    },
    /// The length of a vector is no multiple of the number of components, or that is zero.
    #[error("{len} numbers do not divide into tuples of {components}")]
    Ragged {
        /// Numbers in the vector.
        len: usize,
        /// Components a tuple.
        components: usize,
    },
}

/// `tuples × components` numbers of one type, interleaved, shared and immutable.
#[derive(Clone)]
pub struct DataArray {
    store: Arc<dyn ByteStore>,
    range_bytes: Range<usize>,
    scalar_type: ScalarType,
    components: usize,
    tuples: usize,
}

impl fmt::Debug for DataArray {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "DataArray({} × {} {})",
            self.tuples, self.components, self.scalar_type
        )
    }
}

impl DataArray {
    /// Takes a vector of interleaved tuples.
    ///
    /// # Errors
    /// [`ArrayError::Ragged`] if the length is no multiple of `components`.
    pub fn from_vec<T: Scalar>(values: Vec<T>, components: usize) -> Result<Self, ArrayError> {
        let len = values.len();
        if components == 0 || !len.is_multiple_of(components) {
            return Err(ArrayError::Ragged { len, components });
        }
        let store = TypedStore(values);
        let range_bytes = 0..store.bytes().len();
        Ok(Self {
            store: Arc::new(store),
            range_bytes,
            scalar_type: T::TYPE,
            components,
            tuples: len / components,
        })
    }

    /// A view of part of a store, in native byte order. Nothing is copied if the place is aligned
    /// for the type; otherwise the numbers move into a vector of their own.
    ///
    /// # Errors
    /// [`ArrayError::TooLarge`] or [`ArrayError::OutOfBounds`] if the store is too short.
    pub fn from_store(
        store: Arc<dyn ByteStore>,
        offset_bytes: usize,
        scalar_type: ScalarType,
        components: usize,
        tuples: usize,
    ) -> Result<Self, ArrayError> {
        let end = tuples
            .checked_mul(components)
            .and_then(|n| n.checked_mul(scalar_type.size_bytes()))
            .and_then(|n| n.checked_add(offset_bytes))
            .ok_or(ArrayError::TooLarge {
                tuples,
                components,
                scalar_type,
            })?;
        if components == 0 {
            return Err(ArrayError::Ragged {
                len: tuples,
                components,
            });
        }
        let available = store.bytes().len();
        if end > available {
            return Err(ArrayError::OutOfBounds {
                tuples,
                components,
                scalar_type,
                offset: offset_bytes,
                end,
                available,
            });
        }
        let place = &store.bytes()[offset_bytes..end];
        if place.as_ptr().align_offset(scalar_type.size_bytes()) != 0 {
            return dispatch_scalar!(scalar_type, T => {
                Self::from_vec(bytemuck::allocation::pod_collect_to_vec::<u8, T>(place), components)
            });
        }
        Ok(Self {
            range_bytes: offset_bytes..end,
            store,
            scalar_type,
            components,
            tuples,
        })
    }

    /// The same numbers in tuples of another length; nothing is copied.
    ///
    /// # Errors
    /// [`ArrayError::Ragged`] if they do not divide into such tuples.
    pub fn with_components(mut self, components: usize) -> Result<Self, ArrayError> {
        let len = self.tuples * self.components;
        if components == 0 || !len.is_multiple_of(components) {
            return Err(ArrayError::Ragged { len, components });
        }
        self.components = components;
        self.tuples = len / components;
        Ok(self)
    }

    /// Type of a number.
    pub fn scalar_type(&self) -> ScalarType {
        self.scalar_type
    }

    /// Numbers in a tuple.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Number of tuples.
    pub fn tuples(&self) -> usize {
        self.tuples
    }

    /// All numbers, as bytes in native order.
    pub fn bytes(&self) -> &[u8] {
        &self.store.bytes()[self.range_bytes.clone()]
    }

    /// Says that the numbers are not asked for again soon, here or through other arrays over the same
    /// bytes: see [`ByteStore::release`].
    pub fn release(&self) {
        self.store.release(self.range_bytes.clone());
    }

    /// All numbers, tuple after tuple; `None` if `T` is another type than [`Self::scalar_type`].
    pub fn as_slice<T: Scalar>(&self) -> Option<&[T]> {
        (T::TYPE == self.scalar_type).then(|| bytemuck::cast_slice(self.bytes()))
    }

    /// One number as `f64`.
    ///
    /// # Panics
    /// If the tuple or the component is out of range.
    pub fn get_f64(&self, tuple: usize, component: usize) -> f64 {
        assert!(
            component < self.components,
            "component {component} of {}",
            self.components
        );
        let i = tuple * self.components + component;
        dispatch_scalar!(self.scalar_type, T => {
            bytemuck::cast_slice::<u8, T>(self.bytes())[i].to_f64()
        })
    }

    /// One component as an array of its own; shares the bytes when there is only one.
    ///
    /// # Panics
    /// If the component is out of range.
    pub fn component(&self, component: usize) -> Self {
        assert!(
            component < self.components,
            "component {component} of {}",
            self.components
        );
        if self.components == 1 {
            return self.clone();
        }
        dispatch_scalar!(self.scalar_type, T => {
            let all = bytemuck::cast_slice::<u8, T>(self.bytes());
            let one: Vec<T> = all.iter().skip(component).step_by(self.components).copied().collect();
            Self::from_vec(one, 1).unwrap_or_else(|_| self.clone())
        })
    }

    /// The Euclidean length of every tuple, as `f64` for 64-bit types and `f32` otherwise.
    pub fn magnitude(&self) -> Self {
        let length = |tuple: usize| {
            (0..self.components)
                .map(|c| self.get_f64(tuple, c).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let lengths = (0..self.tuples).map(length);
        let array = if self.scalar_type.size_bytes() == 8 {
            Self::from_vec(lengths.collect::<Vec<f64>>(), 1)
        } else {
            Self::from_vec(lengths.map(|v| v as f32).collect::<Vec<f32>>(), 1)
        };
        array.unwrap_or_else(|_| self.clone())
    }

    /// The range of the finite values of one component, in parallel; `None` if there are none.
    ///
    /// # Panics
    /// If the component is out of range.
    pub fn range(&self, component: usize) -> Option<ValueRange> {
        self.profile(component).range
    }

    /// What one pass over one component tells, in parallel.
    ///
    /// # Panics
    /// If the component is out of range.
    pub fn profile(&self, component: usize) -> ValueProfile {
        use rayon::prelude::*;
        assert!(
            component < self.components,
            "component {component} of {}",
            self.components
        );
        const CHUNK_TUPLES: usize = 1 << 16;
        dispatch_scalar!(self.scalar_type, T => {
            bytemuck::cast_slice::<u8, T>(self.bytes())
                .par_chunks(CHUNK_TUPLES * self.components)
                .map(|chunk| match self.components {
                    1 => ValueProfile::of(chunk.iter().copied()),
                    n => ValueProfile::of(chunk.iter().copied().skip(component).step_by(n)),
                })
                .reduce(|| ValueProfile::EMPTY, ValueProfile::union)
        })
    }
}

/// What is known of the numbers of an array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueProfile {
    /// Range of the finite ones; `None` if there are none.
    pub range: Option<ValueRange>,
    /// Whether all are [plain](Scalar::is_plain): nothing that is computed from them needs to be
    /// looked at for infinities and NaN.
    pub plain: bool,
}

impl ValueProfile {
    /// Of no numbers.
    pub const EMPTY: Self = Self {
        range: None,
        plain: true,
    };

    fn of<T: Scalar>(values: impl Iterator<Item = T> + Clone) -> Self {
        let Some(first) = values.clone().find(|v| v.is_finite()) else {
            let plain = values.clone().next().is_none();
            return Self { plain, range: None };
        };
        let (mut lo, mut hi, mut plain) = (first, first, true);
        // Without branches, so that it becomes vector code.
        for v in values {
            let finite = v.is_finite();
            lo = if finite & (v < lo) { v } else { lo };
            hi = if finite & (v > hi) { v } else { hi };
            plain &= v.is_plain();
        }
        let range = ValueRange {
            lo: lo.to_f64(),
            hi: hi.to_f64(),
        };
        Self {
            range: Some(range),
            plain,
        }
    }

    /// What is known of these numbers and others together.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        let range = match (self.range, other.range) {
            (Some(a), Some(b)) => Some(a.union(b)),
            (a, b) => a.or(b),
        };
        Self {
            range,
            plain: self.plain && other.plain,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_and_ranges() {
        let a = DataArray::from_vec(vec![1.0f32, 10.0, f32::NAN, 20.0, -3.0, f32::INFINITY], 2)
            .expect("six numbers are three pairs");
        assert_eq!(a.tuples(), 3);
        assert_eq!(a.range(0), Some(ValueRange { lo: -3.0, hi: 1.0 }));
        assert_eq!(a.range(1), Some(ValueRange { lo: 10.0, hi: 20.0 }));
        assert!(!a.profile(0).plain && !a.profile(1).plain);
        let plain = |v: [f32; 2]| DataArray::from_vec(v.to_vec(), 1).map(|a| a.profile(0).plain);
        assert_eq!(plain([0.0, -7.5]).ok(), Some(true));
        assert_eq!(plain([1.0, 1e-39]).ok(), Some(true));
        for odd in [2e38, f32::NAN, f32::NEG_INFINITY] {
            assert_eq!(plain([1.0, odd]).ok(), Some(false), "{odd}");
        }
        assert_eq!(a.component(1).as_slice::<f32>().map(|s| s[1]), Some(20.0));
        assert!(a.as_slice::<u8>().is_none());
        assert!((a.magnitude().get_f64(0, 0) - 101f64.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn misaligned_bytes_are_copied() {
        let mut bytes = vec![0u8];
        bytes.extend_from_slice(&7.5f64.to_ne_bytes());
        let a = DataArray::from_store(Arc::new(bytes), 1, ScalarType::F64, 1, 1).expect("fits");
        assert_eq!(a.get_f64(0, 0), 7.5);
    }

    #[test]
    fn lying_sizes_are_refused() {
        let store = Arc::new(vec![0u8; 16]);
        let err = DataArray::from_store(store.clone(), 8, ScalarType::F32, 1, 3).unwrap_err();
        assert!(matches!(
            err,
            ArrayError::OutOfBounds {
                end: 20,
                available: 16,
                ..
            }
        ));
        let err = DataArray::from_store(store, 0, ScalarType::F64, 3, usize::MAX / 4).unwrap_err();
        assert!(matches!(err, ArrayError::TooLarge { .. }));
        assert!(DataArray::from_vec(vec![1u8, 2, 3], 2).is_err());
    }
}
