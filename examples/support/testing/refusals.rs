//! That errors are typed and name what is wrong.

use std::fmt::Debug;

use deep_screen_space::Error;

/// An error of a kind that names a thing and what is accepted in its place.
#[track_caller]
pub fn refused<T>(result: Result<T, Error>, kind: &str, thing: &str, accepted: &str) {
    let Err(error) = result else {
        panic!("{thing} was accepted");
    };
    let debug = format!("{error:?}");
    let text = error.to_string();
    assert!(debug.starts_with(kind), "{debug}, expected {kind}");
    assert!(
        text.contains(thing) && text.contains(accepted),
        "{text}: names {thing}, {accepted}"
    );
}

/// Settings each of which has one field out of its range, which the error names.
#[track_caller]
pub fn fields_refused<S: Debug, const N: usize>(
    cases: [(S, &str); N],
    validate: impl Fn(&S) -> Result<(), Error>,
) {
    for (bad, named) in cases {
        match validate(&bad) {
            Err(Error::Setting { field, .. }) => assert_eq!(field, named, "{bad:?}"),
            other => panic!("{bad:?}: {other:?}"),
        }
    }
}
