//! For tests: what naga finds in the crate's modules, beside which structs and sizes of the CPU's are held.

#[cfg(test)]
use std::sync::LazyLock;

#[cfg(test)]
use crate::{AmbientOcclusion, Effect, shaders};

/// A test named `$test` that a struct has the fields, offsets and size of a struct of the WGSL, in the first module whose name
/// begins with each of those given. Fields whose names begin with `padding` are left out, on either side. What the WGSL has
/// as fields of its own, and the CPU in a struct within, is named by its path. WGSL that knows the first bytes of a struct
/// alone says how many.
macro_rules! same_as_wgsl {
    ($test:ident: $type:ty as $name:literal in [$($module:literal),+ $(,)?]
        { $($($field:ident).+),+ $(,)? }) => {
        $crate::reflection::same_as_wgsl!(
            $test: $type [size_of::<$type>()] as $name in [$($module),+] { $($($field).+),+ }
        );
    };
    ($test:ident: $type:ty [$bytes:expr] as $name:literal in [$($module:literal),+ $(,)?]
        { $($($field:ident).+),+ $(,)? }) => {
        #[cfg(test)]
        #[test]
        fn $test() {
            for module in [$($module),+] {
                $crate::reflection::check(module, $name, $bytes, &[$((
                    stringify!($($field).+),
                    std::mem::offset_of!($type, $($field).+),
                )),+]);
            }
        }
    };
}

/// A test named `$test` that an element of a buffer, whose fields the CPU does not know, has as many bytes as it makes room
/// for.
macro_rules! bytes_of_wgsl {
    ($test:ident: $bytes:expr, as $name:literal in [$($module:literal),+ $(,)?]) => {
        #[cfg(test)]
        #[test]
        fn $test() {
            for module in [$($module),+] {
                $crate::reflection::check_size(module, $name, $bytes as usize);
            }
        }
    };
}

pub(crate) use {bytes_of_wgsl, same_as_wgsl};

/// A struct of the WGSL: the offsets of its fields, and its size.
#[cfg(test)]
type Struct = (Vec<(String, usize)>, usize);

/// One that uses little of what an effect can, and one that uses all.
#[cfg(test)]
pub(crate) fn effects() -> [Effect; 2] {
    let plain = AmbientOcclusion::default().effect();
    let all = Effect {
        source: "
            fn max_distance(s: Sender, e: f32) -> f32 { return s.radius / e; }
            fn contribution(s: Sender, n: vec3f, to: vec3f, d2: f32, r: Receiver) -> Sum {
              let sky = environment_mean(r.to_eye, r.roughness);
              return Sum(vec4f(s.material.emission, 1.0), vec4f(s.front + s.back + sky, 1.0));
            }
            fn resolve(sum: Sum, albedo: vec3f, r: Receiver) -> vec4f {
              return vec4f(sum[1].xyz * albedo * environment_irradiance_at(r.normal), 1.0);
            }"
        .into(),
        channels: 8,
        materials: true,
        radiance: true,
        albedo: true,
        view: true,
        roughness: true,
        environment: true,
        ..plain.clone()
    };
    [plain, all]
}

/// Names of modules, and what naga makes of them.
#[cfg(test)]
static MODULES: LazyLock<Vec<(String, naga::Module)>> = LazyLock::new(|| {
    let modules = effects().map(|effect| shaders(&effect).expect("well-formed directives"));
    let parse = |source: &str| naga::front::wgsl::parse_str(source).expect("valid WGSL");
    let modules = modules.into_iter().flatten();
    modules.map(|m| (m.name, parse(&m.source))).collect()
});

/// The struct `name` of the first module whose name begins so and that has one.
#[cfg(test)]
fn find(module: &str, name: &str) -> Struct {
    MODULES
        .iter()
        .filter(|(found, _)| found.starts_with(module))
        .flat_map(|(_, module)| module.types.iter())
        .find_map(|(_, ty)| match (&ty.name, &ty.inner) {
            (Some(found), naga::TypeInner::Struct { members, span }) if found == name => Some((
                members
                    .iter()
                    .map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize))
                    .collect(),
                *span as usize,
            )),
            _ => None,
        })
        .unwrap_or_else(|| panic!("{module} has no struct {name}"))
}

#[cfg(test)]
pub(crate) fn check(module: &str, name: &str, bytes: usize, fields: &[(&str, usize)]) {
    let (members, span) = find(module, name);
    assert_eq!(span, bytes, "{module}: size of {name}");
    let is_padding = |name: &str| name.starts_with("padding");
    let members: Vec<_> = members
        .iter()
        .map(|(name, offset)| (name.as_str(), *offset))
        .filter(|(name, _)| !is_padding(name))
        .collect();
    let fields: Vec<_> = fields
        .iter()
        .map(|&(path, offset)| (path.rsplit('.').next().unwrap_or(path).trim(), offset))
        .filter(|(name, _)| !is_padding(name))
        .collect();
    assert_eq!(members, fields, "{module}: {name}");
}

#[cfg(test)]
pub(crate) fn check_size(module: &str, name: &str, bytes: usize) {
    assert_eq!(find(module, name).1, bytes, "{module}: size of {name}");
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    /// What the WGSL takes for a vector.
    const VECTORS: [&str; 1] = ["Surfel"];

    /// Each struct that is cast to bytes has a test of its own beside it.
    #[test]
    fn no_struct_is_unchecked() {
        let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
        let mut unchecked = Vec::new();
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).expect("the folder") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    folders.push(path);
                    continue;
                }
                let text = fs::read_to_string(&path).expect("a text");
                let derives = text.split("#[derive(").skip(1);
                let pods = derives.filter(|after| {
                    after
                        .split(')')
                        .next()
                        .is_some_and(|list| list.contains("Pod"))
                });
                for after in pods {
                    let name = after.split("struct ").nth(1).unwrap_or_default();
                    let name = name.split(|c: char| !c.is_alphanumeric()).next();
                    let name = name.unwrap_or_default();
                    let checked = text.split("same_as_wgsl!(").skip(1).any(|after| {
                        let ty = after.split(':').nth(1).unwrap_or_default();
                        ty.trim_start().starts_with(&format!("{name} "))
                    });
                    if !checked && !VECTORS.contains(&name) {
                        unchecked.push(format!("{name} in {}", path.display()));
                    }
                }
            }
        }
        assert!(unchecked.is_empty(), "{unchecked:#?}");
    }
}
