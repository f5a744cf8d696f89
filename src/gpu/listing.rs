//! How passes list their modules.

use wgpu::Features;

/// One module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shader {
    /// The file in `wgsl/` that it is assembled from, then the variant.
    pub name: String,
    /// The text.
    pub source: String,
    /// What the device must offer for it.
    pub features: Features,
}

/// What the passes add their modules to; `E` is what those that import an effect are assembled for.
pub(crate) struct Listing<'a, E> {
    pub effect: &'a E,
    pub shaders: Vec<Shader>,
}

impl<E> Listing<'_, E> {
    /// A module that every device can run.
    pub fn add(&mut self, name: &str, source: String) {
        self.add_for(Features::empty(), name, source);
    }

    /// A module that needs features of the device.
    pub fn add_for(&mut self, features: Features, name: &str, source: String) {
        self.shaders.push(Shader {
            name: name.into(),
            source,
            features,
        });
    }
}

/// The name of a variant: that of the file and the words for what it has.
pub(crate) fn name_of(file: &str, has: &[(bool, &str)]) -> String {
    let mut name = file.to_owned();
    for (_, word) in has.iter().filter(|(has, _)| *has) {
        name.push(' ');
        name.push_str(word);
    }
    name
}
