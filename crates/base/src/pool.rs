//! Reusable workspaces, one per thread at work.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, PoisonError};

/// Workspaces that outlive a parallel loop, so that the loop allocates nothing.
///
/// A lease is taken for many tiles or batches: the lock costs nothing beside their work.
#[derive(Debug, Default)]
pub struct Pool<T>(Mutex<Vec<T>>);

impl<T: Default> Pool<T> {
    /// A workspace for exclusive use; it returns to the pool when dropped.
    pub fn lease(&self) -> Lease<'_, T> {
        // A poisoned lock is harmless: each workspace is reset where it is used.
        let free = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        Lease { pool: self, workspace: free.unwrap_or_default() }
    }

    /// All workspaces that are not leased.
    pub fn free_mut(&mut self) -> &mut [T] {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A workspace on loan.
#[derive(Debug)]
pub struct Lease<'a, T: Default> {
    pool: &'a Pool<T>,
    workspace: T,
}

impl<T: Default> Deref for Lease<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.workspace
    }
}

impl<T: Default> DerefMut for Lease<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.workspace
    }
}

impl<T: Default> Drop for Lease<'_, T> {
    fn drop(&mut self) {
        let workspace = std::mem::take(&mut self.workspace);
        self.pool.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}
