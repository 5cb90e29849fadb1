//! Memory that work items use one after the other, as many pieces as run at a time.

use std::sync::{Mutex, PoisonError};

/// Pieces of memory that nobody uses just now.
#[derive(Default)]
pub struct Pool<T>(Mutex<Vec<T>>);

impl<T: Default> Pool<T> {
    /// Does something with a piece of memory, in the state in which it was left.
    pub fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut piece = lock().pop().unwrap_or_default();
        let result = work(&mut piece);
        lock().push(piece);
        result
    }
}
