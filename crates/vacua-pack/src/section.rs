//! Flat arrays over shared bytes: what was just encoded, or a piece of a mapped file.

use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

use bytemuck::Pod;
use vacua_volume::ByteStore;

/// A vector as a byte store; the allocation keeps the alignment of its type.
struct PodVec<T>(Vec<T>);

impl<T: Pod + Send + Sync> ByteStore for PodVec<T> {
    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

/// An immutable array of plain records. Clones share the bytes.
#[derive(Clone)]
pub struct Flat<T> {
    store: Arc<dyn ByteStore>,
    place: Range<usize>,
    element: PhantomData<T>,
}

impl<T: Pod + Send + Sync> Flat<T> {
    /// Takes a vector.
    pub fn from_vec(values: Vec<T>) -> Self {
        let place = 0..size_of_val(values.as_slice());
        Self {
            store: Arc::new(PodVec(values)),
            place,
            element: PhantomData,
        }
    }

    /// Part of a store; `None` if it ends before, is not aligned for `T`, or holds part of a record.
    pub fn from_store(store: Arc<dyn ByteStore>, place: Range<usize>) -> Option<Self> {
        let bytes = store.bytes().get(place.clone())?;
        bytemuck::try_cast_slice::<u8, T>(bytes).ok()?;
        Some(Self {
            store,
            place,
            element: PhantomData,
        })
    }

    /// The records.
    #[inline(always)]
    pub fn as_slice(&self) -> &[T] {
        bytemuck::cast_slice(self.bytes())
    }

    /// The records as bytes.
    #[inline(always)]
    pub fn bytes(&self) -> &[u8] {
        &self.store.bytes()[self.place.clone()]
    }

    /// Length in bytes.
    pub fn num_bytes(&self) -> usize {
        self.place.len()
    }
}
