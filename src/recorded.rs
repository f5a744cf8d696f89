//! What objects were recorded from: so that one that was not, or not of this, or not since, is refused.
//!
//! Recordings are counted where they are recorded. In which order encoders are submitted nothing here knows.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicU64, Ordering},
};

use crate::error::Error;

/// How often an object was recorded. Its address is the object's identity.
#[derive(Debug, Default)]
pub(crate) struct Recordings(Arc<AtomicU64>);

/// One recording of an object. Whether it is the last one can be asked without the object.
#[derive(Clone, Debug)]
pub(crate) struct Stamp {
    of: Arc<AtomicU64>,
    count: u64,
}

impl Recordings {
    /// Counts one more.
    pub fn advance(&self) -> Stamp {
        Stamp {
            count: self.0.fetch_add(1, Ordering::Relaxed) + 1,
            of: Arc::clone(&self.0),
        }
    }

    /// The last one, of an object that the caller calls `name`.
    pub fn last(&self, name: &'static str) -> Result<Stamp, Error> {
        match self.0.load(Ordering::Relaxed) {
            0 => Err(never(name)),
            count => Ok(Stamp {
                of: Arc::clone(&self.0),
                count,
            }),
        }
    }
}

impl Stamp {
    /// [`Error::Recording`] for `name`, which was recorded from this, unless this is the last recording of `source`.
    pub fn check(
        &self,
        name: &'static str,
        source: &'static str,
        recordings: &Recordings,
    ) -> Result<(), Error> {
        let found = if !Arc::ptr_eq(&self.of, &recordings.0) {
            format!("recorded from another {source}")
        } else if self.is_last() {
            return Ok(());
        } else {
            format!("recorded before the last recording of the {source}")
        };
        Err(Error::Recording { name, found })
    }

    /// The same without the object.
    pub fn check_last(&self, name: &'static str, source: &'static str) -> Result<(), Error> {
        if self.is_last() {
            return Ok(());
        }
        Err(Error::Recording {
            name,
            found: format!("recorded before the last recording of the {source}"),
        })
    }

    fn is_last(&self) -> bool {
        self.of.load(Ordering::Relaxed) == self.count
    }
}

/// [`Error::Recording`] for what was never recorded.
pub(crate) fn never(name: &'static str) -> Error {
    Error::Recording {
        name,
        found: "not recorded".into(),
    }
}

/// What was recorded last into an object that passes share, as they share textures and buffers.
#[derive(Debug)]
pub(crate) struct Last<T>(Mutex<Option<T>>);

impl<T> Default for Last<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T: Clone> Last<T> {
    pub fn set(&self, value: T) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
    }

    /// [`Error::Recording`] where there is none.
    pub fn get(&self, name: &'static str) -> Result<T, Error> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.clone().ok_or_else(|| never(name))
    }
}
