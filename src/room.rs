//! Textures and buffers that a view makes with its first recording, and anew where they no longer fit.

use crate::error::Error;

/// What is there where it fits, or what is made in its place. The old goes before there is a new one, so that memory is never
/// held for both.
pub(crate) fn room_for<T>(
    room: &mut Option<T>,
    fits: impl FnOnce(&T) -> bool,
    make: impl FnOnce() -> Result<T, Error>,
) -> Result<&mut T, Error> {
    room.take_if(|room| !fits(room));
    match room {
        Some(room) => Ok(room),
        None => Ok(room.insert(make()?)),
    }
}

#[cfg(test)]
mod tests {
    use std::rc::{Rc, Weak};

    use super::*;

    #[test]
    fn what_fits_stays_and_what_does_not_goes_first() {
        let none = Error::Setting {
            field: "size",
            value: 0.0,
            accepted: "some",
        };
        let mut room = Some(Rc::new(1));
        let kept = room_for(&mut room, |n| **n == 1, || Err(none.clone()));
        assert_eq!(kept, Ok(&mut Rc::new(1)));
        let old: Weak<i32> = room.as_ref().map(Rc::downgrade).unwrap_or_default();
        let made = room_for(
            &mut room,
            |n| **n == 2,
            || {
                assert_eq!(old.strong_count(), 0);
                Ok(Rc::new(2))
            },
        );
        assert_eq!(made, Ok(&mut Rc::new(2)));
        // Where none can be had there is none, and the next recording asks again.
        let made = room_for(&mut room, |_| false, || Err(none.clone()));
        assert_eq!(made, Err(none));
        assert_eq!(room, None);
    }
}
