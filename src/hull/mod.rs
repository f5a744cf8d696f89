//! Light on the hull in two objects and two recordings per frame: what a light's map shows, and one view's picture.

pub(crate) mod lights;
pub(crate) mod view;
