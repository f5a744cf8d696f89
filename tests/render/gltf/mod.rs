//! The examples' glTF files: read as the specification has them, and refused with one line where they are broken.

mod broken;
mod emission;
mod files;
mod geometry;
mod masks;
mod mutations;
mod nodes;
mod uris;
