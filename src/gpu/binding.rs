//! Bind group layouts as the WGSL has them, and bind groups by the names of its variables.

use std::sync::{Mutex, PoisonError};

use wgpu::{
    BindGroup, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BindingResource, BindingType,
    Buffer, BufferBinding, Device, ShaderStages, TextureView, Tlas,
};

use super::interface::{Interface, Variable};
use crate::{
    error::{Error, check_limit},
    geometry::{check_size, check_usage},
    made,
};

/// What is bound as a variable.
#[derive(Clone, Debug)]
pub(crate) struct Resource<'a> {
    pub raw: BindingResource<'a>,
    /// Of a uniform.
    pub offset: Option<u32>,
}

/// A variable's name, and what is bound as it.
pub(crate) type Named<'a> = (&'a str, Resource<'a>);

/// What some entry points bind in a group.
#[derive(Debug)]
pub(crate) struct Layout {
    pub raw: BindGroupLayout,
    label: String,
    /// Names and numbers, by the number.
    variables: Vec<(String, u32)>,
}

/// A bind group and the offsets of its uniforms, for `set_bind_group`.
#[derive(Debug)]
pub(crate) struct Group {
    pub raw: BindGroup,
    pub offsets: Vec<u32>,
}

impl Layout {
    /// That of a group of a module's entry points. Variables that the caller's code declares are not the crate's to bind.
    pub fn new(
        device: &Device,
        label: &str,
        interface: &Interface,
        group: u32,
        entries: &[&str],
        foreign: &Interface,
    ) -> Self {
        let own = |variable: &&Variable| {
            let is_foreign = foreign.variables.iter().any(|v| v.name == variable.name);
            variable.group == group && !is_foreign
        };
        let variables = interface.variables.iter().filter(own).filter_map(|v| {
            let stages = interface.stages(&v.name, entries);
            (!stages.is_empty()).then_some((v, v.ty, stages))
        });
        Self::of(device, label, variables.collect())
    }

    fn of(
        device: &Device,
        label: &str,
        mut variables: Vec<(&Variable, BindingType, ShaderStages)>,
    ) -> Self {
        variables.sort_by_key(|(variable, ..)| variable.binding);
        let entries: Vec<_> = variables
            .iter()
            .map(|&(variable, ty, visibility)| BindGroupLayoutEntry {
                binding: variable.binding,
                visibility,
                ty,
                count: None,
            })
            .collect();
        Self {
            raw: device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries: &entries,
            }),
            label: label.into(),
            variables: variables
                .iter()
                .map(|(variable, ..)| (variable.name.clone(), variable.binding))
                .collect(),
        }
    }

    /// Names of what is bound.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.variables.iter().map(|(name, _)| name.as_str())
    }

    /// A bind group for one recording. A variable that nothing is given for is a validation error of wgpu's; what the layout
    /// does not have is a mistake in this crate.
    pub fn group(&self, device: &Device, resources: &[Named<'_>]) -> Group {
        self.filled(device, &self.sorted(resources))
    }

    /// Numbers and resources, by the number.
    fn sorted<'a, 'r>(&self, resources: &'a [Named<'r>]) -> Vec<(u32, &'a Resource<'r>)> {
        debug_assert!(
            resources
                .iter()
                .all(|(name, _)| self.names().any(|own| own == *name)),
            "{} binds {:?}, and is given {:?}",
            self.label,
            self.names().collect::<Vec<_>>(),
            resources.iter().map(|(name, _)| name).collect::<Vec<_>>(),
        );
        self.variables
            .iter()
            .filter_map(|(name, number)| {
                let given = resources.iter().find(|(given, _)| given == name);
                given.map(|(_, resource)| (*number, resource))
            })
            .collect()
    }

    fn filled(&self, device: &Device, sorted: &[(u32, &Resource<'_>)]) -> Group {
        made::count(made::Kind::BindGroup);
        let entries: Vec<_> = sorted
            .iter()
            .map(|&(binding, resource)| BindGroupEntry {
                binding,
                resource: resource.raw.clone(),
            })
            .collect();
        Group {
            raw: device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(&self.label),
                layout: &self.raw,
                entries: &entries,
            }),
            offsets: offsets(sorted),
        }
    }
}

fn offsets(sorted: &[(u32, &Resource<'_>)]) -> Vec<u32> {
    sorted.iter().filter_map(|(_, r)| r.offset).collect()
}

/// The layout of a piece of WGSL with functions for several stages, whose uniforms have no offsets.
pub(crate) fn layout_of_piece(
    device: &Device,
    label: &str,
    interface: &Interface,
    stages: ShaderStages,
) -> BindGroupLayout {
    let fixed = |ty| match ty {
        BindingType::Buffer { ty, .. } => BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        other => other,
    };
    let variables = interface.variables.iter();
    let variables = variables.map(|v| (v, fixed(v.ty), stages));
    Layout::of(device, label, variables.collect()).raw
}

/// Resources at the numbers that such a piece has them at.
pub(crate) fn entries<'a>(
    interface: &Interface,
    resources: &[Named<'a>],
) -> Vec<BindGroupEntry<'a>> {
    let number = |name| interface.variables.iter().find(|v| v.name == name);
    resources
        .iter()
        .filter_map(|(name, resource)| {
            number(*name).map(|variable| BindGroupEntry {
                binding: variable.binding,
                resource: resource.raw.clone(),
            })
        })
        .collect()
}

/// The bind groups of an object's last recording, in their order. The next one, which will most likely ask for the same,
/// takes them over; what it does not ask for is dropped then. An object keeps what it was last recorded with no longer than
/// that.
#[derive(Debug, Default)]
pub(crate) struct Kept(Mutex<Vec<KeptGroup>>);

#[derive(Debug)]
struct KeptGroup {
    layout: BindGroupLayout,
    resources: Vec<Identity>,
    raw: BindGroup,
}

impl KeptGroup {
    fn is(&self, layout: &Layout, sorted: &[(u32, &Resource<'_>)]) -> bool {
        let mut pairs = self.resources.iter().zip(sorted);
        self.layout == layout.raw
            && self.resources.len() == sorted.len()
            && pairs.all(|(own, (_, given))| own.is(given))
    }

    /// It with the offsets of these.
    fn with(&self, sorted: &[(u32, &Resource<'_>)]) -> Group {
        Group {
            raw: self.raw.clone(),
            offsets: offsets(sorted),
        }
    }
}

/// What a resource is: wgpu's objects are equal where they are the same.
#[derive(Debug, PartialEq)]
enum Identity {
    Buffer(Buffer, u64, Option<std::num::NonZeroU64>),
    View(TextureView),
    Tlas(Tlas),
}

impl Identity {
    fn of(resource: &Resource<'_>) -> Option<Self> {
        match &resource.raw {
            BindingResource::Buffer(part) => {
                Some(Self::Buffer(part.buffer.clone(), part.offset, part.size))
            }
            BindingResource::TextureView(view) => Some(Self::View((*view).clone())),
            BindingResource::AccelerationStructure(tlas) => Some(Self::Tlas((*tlas).clone())),
            _ => None,
        }
    }

    fn is(&self, resource: &Resource<'_>) -> bool {
        match (self, &resource.raw) {
            (Self::Buffer(buffer, offset, size), BindingResource::Buffer(part)) => {
                buffer == part.buffer && *offset == part.offset && *size == part.size
            }
            (Self::View(own), BindingResource::TextureView(view)) => own == *view,
            (Self::Tlas(own), BindingResource::AccelerationStructure(tlas)) => own == *tlas,
            _ => false,
        }
    }
}

impl Kept {
    /// Begins a recording.
    pub fn groups<'a>(&'a self, device: &'a Device) -> Groups<'a> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        Groups {
            device,
            kept: self,
            list: std::mem::take(&mut *kept),
            next: 0,
        }
    }
}

/// The bind groups of a recording.
pub(crate) struct Groups<'a> {
    device: &'a Device,
    kept: &'a Kept,
    list: Vec<KeptGroup>,
    next: usize,
}

impl Groups<'_> {
    /// One that is made anew each time, for what is the caller's.
    pub fn unkept(&self, layout: &Layout, resources: &[Named<'_>]) -> Group {
        layout.group(self.device, resources)
    }

    /// The next one.
    pub fn next(&mut self, layout: &Layout, resources: &[Named<'_>]) -> Group {
        let sorted = layout.sorted(resources);
        let at = self.next;
        self.next += 1;
        if let Some(kept) = self.list.get(at).filter(|kept| kept.is(layout, &sorted)) {
            return kept.with(&sorted);
        }
        self.list.truncate(at);
        // Stages of levels take turns between two buffers, if they do not share all.
        let before = self
            .list
            .iter()
            .rev()
            .take(2)
            .find(|kept| kept.is(layout, &sorted));
        let group = match before {
            Some(kept) => kept.with(&sorted),
            None => layout.filled(self.device, &sorted),
        };
        self.list.push(KeptGroup {
            layout: layout.raw.clone(),
            resources: sorted
                .iter()
                .filter_map(|(_, given)| Identity::of(given))
                .collect(),
            raw: group.raw.clone(),
        });
        group
    }
}

impl Drop for Groups<'_> {
    fn drop(&mut self) {
        self.list.truncate(self.next);
        let mut kept = self.kept.0.lock().unwrap_or_else(PoisonError::into_inner);
        *kept = std::mem::take(&mut self.list);
    }
}

/// A whole buffer as a binding.
pub(crate) fn whole(buffer: &Buffer) -> Resource<'_> {
    fixed(buffer.as_entire_binding())
}

const fn fixed(raw: BindingResource<'_>) -> Resource<'_> {
    Resource { raw, offset: None }
}

/// The first bytes of a buffer of the caller's as a binding. It may be of any size, and a binding is whole words.
pub(crate) fn first(buffer: &Buffer, bytes: u64) -> Resource<'_> {
    part(buffer, 0, bytes)
}

/// Some bytes of a buffer of the caller's.
pub(crate) fn part(buffer: &Buffer, offset: u64, bytes: u64) -> Resource<'_> {
    fixed(BindingResource::Buffer(BufferBinding {
        buffer,
        offset,
        size: std::num::NonZeroU64::new(bytes),
    }))
}

/// As many elements as a buffer of the caller's holds.
pub(crate) fn table<T>(buffer: &Buffer) -> Resource<'_> {
    first(buffer, table_bytes::<T>(buffer))
}

fn table_bytes<T>(buffer: &Buffer) -> u64 {
    let element = size_of::<T>() as u64;
    buffer.size() / element * element
}

/// Checks that a buffer can be bound as at least one element, and as all that it holds.
pub(crate) fn check_table<T>(
    device: &Device,
    name: &'static str,
    buffer: &Buffer,
) -> Result<(), Error> {
    check_usage(name, buffer)?;
    check_size(name, buffer, size_of::<T>() as u64)?;
    check_bytes(device, name, table_bytes::<T>(buffer))
}

/// Checks that a buffer's first bytes can be bound.
pub(crate) fn check_first(
    device: &Device,
    name: &'static str,
    buffer: &Buffer,
    bytes: u64,
) -> Result<(), Error> {
    check_usage(name, buffer)?;
    check_size(name, buffer, bytes)?;
    check_bytes(device, name, bytes)
}

fn check_bytes(device: &Device, name: &'static str, bytes: u64) -> Result<(), Error> {
    let limit = device.limits().max_storage_buffer_binding_size;
    check_limit("max_storage_buffer_binding_size", limit, bytes, name)
}

/// [`Error::Buffer`] for a buffer of the caller's that is one of those that the same pass uses otherwise.
pub(crate) fn check_own<'b>(
    name: &'static str,
    buffer: &Buffer,
    others: impl IntoIterator<Item = &'b Buffer>,
) -> Result<(), Error> {
    if others.into_iter().any(|other| other == buffer) {
        return Err(Error::Buffer {
            name,
            found: "a buffer that the pass uses otherwise".into(),
            needed: "a buffer of its own".into(),
        });
    }
    Ok(())
}

/// A texture view as a binding.
pub(crate) const fn view(view: &TextureView) -> Resource<'_> {
    fixed(BindingResource::TextureView(view))
}

/// A device's acceleration structure as a binding.
#[cfg(feature = "ray-query")]
pub(crate) fn structure(tlas: &Tlas) -> Resource<'_> {
    fixed(tlas.as_binding())
}
