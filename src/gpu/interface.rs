//! What a module binds, read off its WGSL: where its bindings' numbers stand, and nowhere else.
//!
//! A pass asks for the layout of some entry points and gets what these use, themselves or by what they call; it fills bind
//! groups by the names of the variables. A parser would know more, but there is none in a browser without another megabyte of
//! code, and on native devices every module would be parsed twice. Scopes are followed, so that a local variable that is named
//! as a binding is none. A test holds all of the crate's modules against naga.

use std::collections::{BTreeMap, BTreeSet};

use wgpu::{
    BindingType, BufferBindingType, ShaderStages, StorageTextureAccess, TextureFormat,
    TextureSampleType, TextureViewDimension,
};

use super::tokens::{tokens, without_comments};

/// A variable with `@group` and `@binding`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Variable {
    pub name: String,
    pub group: u32,
    pub binding: u32,
    pub ty: BindingType,
}

/// What a module binds, and which of it its entry points use.
#[derive(Debug, Default)]
pub(crate) struct Interface {
    pub variables: Vec<Variable>,
    entries: BTreeMap<String, Entry>,
}

#[derive(Debug)]
struct Entry {
    stage: ShaderStages,
    /// Names of variables.
    uses: BTreeSet<String>,
}

/// A function of a module: its stage where it is an entry point, and the names of module scope in it.
struct Function<'a> {
    stage: Option<ShaderStages>,
    names: BTreeSet<&'a str>,
}

impl Interface {
    /// Of a whole module, or of a piece of one. What is no valid WGSL has some interface or other: the device refuses it.
    pub fn of(source: &str) -> Self {
        let source: String = without_comments(source)
            .lines()
            .filter(|line| !line.trim_start().starts_with('#'))
            .flat_map(|line| [line, "\n"])
            .collect();
        let mut reader = Reader {
            tokens: &tokens(&source),
            at: 0,
        };
        let mut variables = Vec::new();
        let mut functions = BTreeMap::new();
        while reader.at < reader.tokens.len() {
            reader.declaration(&mut variables, &mut functions);
        }
        let entries = functions
            .iter()
            .filter_map(|(name, function)| {
                let mut seen = BTreeSet::new();
                follow(name, &functions, &mut seen);
                let uses = variables.iter().map(|v: &Variable| v.name.as_str());
                let uses = uses.filter(|v| seen.contains(v)).map(Into::into).collect();
                let stage = function.stage?;
                Some(((*name).to_owned(), Entry { stage, uses }))
            })
            .collect();
        Self { variables, entries }
    }

    /// The stages of some entry points that use a variable.
    pub fn stages(&self, variable: &str, entries: &[&str]) -> ShaderStages {
        entries
            .iter()
            .filter_map(|entry| self.entries.get(*entry))
            .filter(|entry| entry.uses.contains(variable))
            .fold(ShaderStages::empty(), |all, entry| all | entry.stage)
    }

    /// Names of all entry points.
    #[cfg(test)]
    pub fn entries(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }
}

/// All names that a function can reach.
fn follow<'a>(
    name: &'a str,
    functions: &BTreeMap<&'a str, Function<'a>>,
    seen: &mut BTreeSet<&'a str>,
) {
    let Some(function) = functions.get(name) else {
        return;
    };
    for name in &function.names {
        if seen.insert(name) {
            follow(name, functions, seen);
        }
    }
}

/// Reads declarations one after the other.
struct Reader<'a, 't> {
    tokens: &'t [&'a str],
    at: usize,
}

impl<'a> Reader<'a, '_> {
    fn peek(&self) -> &'a str {
        self.tokens.get(self.at).copied().unwrap_or("")
    }

    fn next(&mut self) -> &'a str {
        let token = self.peek();
        self.at += 1;
        token
    }

    /// What stands in brackets, where an opening one is next.
    fn bracketed(&mut self, [open, close]: [&str; 2]) -> &[&'a str] {
        if self.peek() != open {
            return &[];
        }
        self.at += 1;
        let start = self.at;
        let mut depth = 1;
        while self.at < self.tokens.len() {
            let token = self.next();
            depth += i32::from(token == open) - i32::from(token == close);
            if depth == 0 {
                return &self.tokens[start..self.at - 1];
            }
        }
        &self.tokens[start..]
    }

    /// One at module scope.
    fn declaration(
        &mut self,
        variables: &mut Vec<Variable>,
        functions: &mut BTreeMap<&'a str, Function<'a>>,
    ) {
        let (mut group, mut binding, mut stage) = (None, None, None);
        while self.peek() == "@" {
            self.at += 1;
            let attribute = self.next();
            let number = self.bracketed(["(", ")"]).first();
            let number = number.and_then(|number| number.trim_end_matches('u').parse().ok());
            match attribute {
                "group" => group = number,
                "binding" => binding = number,
                "compute" => stage = Some(ShaderStages::COMPUTE),
                "vertex" => stage = Some(ShaderStages::VERTEX),
                "fragment" => stage = Some(ShaderStages::FRAGMENT),
                _ => {}
            }
        }
        match self.next() {
            "var" => {
                let space = self.bracketed(["<", ">"]).concat();
                let name = self.next();
                let start = self.at;
                self.end_of_statement();
                let ty = self.tokens[start..self.at - 1].concat();
                let ty = binding_type(&space, ty.trim_start_matches(':'));
                if let (Some(group), Some(binding), Some(ty)) = (group, binding, ty) {
                    variables.push(Variable {
                        name: name.into(),
                        group,
                        binding,
                        ty,
                    });
                }
            }
            "fn" => {
                let name = self.next();
                let parameters = self.bracketed(["(", ")"]);
                let locals = names_before_colons(parameters);
                while self.at < self.tokens.len() && self.peek() != "{" {
                    self.at += 1;
                }
                let body = self.bracketed(["{", "}"]);
                let names = names_of_module_scope(body, locals);
                functions.insert(name, Function { stage, names });
            }
            "struct" => {
                self.at += 1;
                self.bracketed(["{", "}"]);
            }
            ";" => {}
            _ => self.end_of_statement(),
        }
    }

    /// Goes on behind the next semicolon.
    fn end_of_statement(&mut self) {
        while self.at < self.tokens.len() && self.next() != ";" {}
    }
}

/// The parameters of a function.
fn names_before_colons<'a>(tokens: &[&'a str]) -> BTreeSet<&'a str> {
    tokens
        .windows(2)
        .filter(|pair| pair[1] == ":")
        .map(|pair| pair[0])
        .collect()
}

/// The words of a function's body that are no local variables, members or attributes.
fn names_of_module_scope<'a>(body: &[&'a str], parameters: BTreeSet<&'a str>) -> BTreeSet<&'a str> {
    let mut names = BTreeSet::new();
    // A loop's header is a scope about that of its body.
    let mut scopes = vec![(parameters, false)];
    let mut before = "";
    // A variable is known behind its declaration.
    let mut declared = None;
    let mut at = 0;
    while let Some(&token) = body.get(at) {
        at += 1;
        match token {
            "for" => scopes.push((BTreeSet::new(), true)),
            "{" => scopes.push((BTreeSet::new(), false)),
            "}" => {
                scopes.pop();
                if scopes.last().is_some_and(|scope| scope.1) {
                    scopes.pop();
                }
            }
            ";" => {
                if let (Some(name), Some(scope)) = (declared.take(), scopes.last_mut()) {
                    scope.0.insert(name);
                }
            }
            "let" | "var" | "const" => {
                if body.get(at) == Some(&"<") {
                    at += body[at..].iter().position(|t| *t == ">").unwrap_or(0) + 1;
                }
                declared = body.get(at).copied();
                at += 1;
            }
            _ if before == "." || before == "@" => {}
            _ if scopes.iter().any(|scope| scope.0.contains(token)) => {}
            _ => {
                names.insert(token);
            }
        }
        before = token;
    }
    names
}

/// What a variable is bound as: uniforms with a dynamic offset.
fn binding_type(space: &str, ty: &str) -> Option<BindingType> {
    let buffer = |ty, has_dynamic_offset| BindingType::Buffer {
        ty,
        has_dynamic_offset,
        min_binding_size: None,
    };
    let storage = |read_only| buffer(BufferBindingType::Storage { read_only }, false);
    match space {
        "" => {}
        "uniform" => return Some(buffer(BufferBindingType::Uniform, true)),
        "storage" | "storage,read" => return Some(storage(true)),
        "storage,read_write" => return Some(storage(false)),
        _ => return None,
    }
    if ty == "acceleration_structure" {
        return Some(BindingType::AccelerationStructure {
            vertex_return: false,
        });
    }
    let (kind, of) = ty.trim_end_matches('>').split_once('<')?;
    let view_dimension = if kind.ends_with("_array") {
        TextureViewDimension::D2Array
    } else {
        TextureViewDimension::D2
    };
    match kind {
        "texture_2d" | "texture_2d_array" => Some(BindingType::Texture {
            // Read with `textureLoad` alone, so that depth textures bind to it too.
            sample_type: match of {
                "f32" => TextureSampleType::Float { filterable: false },
                "u32" => TextureSampleType::Uint,
                _ => return None,
            },
            view_dimension,
            multisampled: false,
        }),
        "texture_storage_2d" | "texture_storage_2d_array" => Some(BindingType::StorageTexture {
            access: StorageTextureAccess::WriteOnly,
            format: match of.strip_suffix(",write")? {
                "r32float" => TextureFormat::R32Float,
                "rg32float" => TextureFormat::Rg32Float,
                "rgba16float" => TextureFormat::Rgba16Float,
                "rgba32float" => TextureFormat::Rgba32Float,
                "r32uint" => TextureFormat::R32Uint,
                "rgba32uint" => TextureFormat::Rgba32Uint,
                _ => return None,
            },
            view_dimension,
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use naga::{AddressSpace, ImageClass, ShaderStage, StorageAccess, TypeInner};

    use super::*;
    use crate::{reflection::effects, shaders};

    /// The names of module scope that `f` is found to use.
    fn used(source: &str) -> Vec<String> {
        let interface = Interface::of(&format!(
            "@group(0) @binding(0) var<uniform> a: A;
             @group(0) @binding(1) var<storage, read_write> b: array<vec2<u32>>;
             @group(1) @binding(2) var c: texture_2d<f32>;
             struct A {{ @size(16) b: f32, c: f32 }}
             const K = array<u32, 2>(1, 2);
             {source}"
        ));
        let names = interface.variables.iter().map(|v| v.name.clone());
        names
            .filter(|name| !interface.stages(name, &["f"]).is_empty())
            .collect()
    }

    #[test]
    fn uses_are_found_by_scope() {
        let main = "@compute @workgroup_size(64, 1) fn f(@builtin(global_invocation_id) id: vec3u)";
        for (source, expected) in [
            ("{ b[0] = a.c; }", &["a", "b"][..]),
            ("{ let b = 1; let x = b; }", &[]),
            ("{ let a = a.c; let x = a; }", &["a"]),
            ("{ if true { let a = 1; } let x = a; }", &["a"]),
            ("{ for (var a = 0; a < 1; a++) { let x = a; } }", &[]),
            (
                "{ for (var a = 0; a < 1; a++) { let x = a; } let y = a; }",
                &["a"],
            ),
            ("{ var<function> a: f32 = 1.0; a += 1.0f; }", &[]),
            ("{ let x = X(1.0).a; }", &[]),
            ("{ g(&b); }", &["b", "c"]),
            ("{ h(1); }", &[]),
            ("{ // a\n /* b /* c */ a */ }", &[]),
            (
                "{ @diagnostic(off, a) switch K[1] { case 1: { let a = 1; } default: {} } }",
                &[],
            ),
        ] {
            let found = used(&format!(
                "{main} {source}
                 fn g(b: ptr<storage, array<vec2u>, read_write>) {{ let s = textureDimensions(c); }}
                 fn h(a: i32) -> i32 {{ return a; }}"
            ));
            let expected: Vec<_> = expected.iter().map(|&name| name.to_owned()).collect();
            // Names of attributes' arguments count, but there are none that are bindings.
            let found: Vec<_> = found
                .into_iter()
                .filter(|name| !(source.contains("off, a") && name == "a"))
                .collect();
            assert_eq!(found, expected, "{source}");
        }
    }

    fn naga_type(module: &naga::Module, variable: &naga::GlobalVariable) -> BindingType {
        let buffer = |ty, has_dynamic_offset| BindingType::Buffer {
            ty,
            has_dynamic_offset,
            min_binding_size: None,
        };
        if let TypeInner::AccelerationStructure { vertex_return } = module.types[variable.ty].inner
        {
            return BindingType::AccelerationStructure { vertex_return };
        }
        let TypeInner::Image {
            dim: naga::ImageDimension::D2,
            arrayed,
            class,
        } = module.types[variable.ty].inner
        else {
            return match variable.space {
                AddressSpace::Uniform => buffer(BufferBindingType::Uniform, true),
                AddressSpace::Storage { access } => buffer(
                    BufferBindingType::Storage {
                        read_only: !access.contains(StorageAccess::STORE),
                    },
                    false,
                ),
                space => panic!("{space:?}"),
            };
        };
        let view_dimension = if arrayed {
            TextureViewDimension::D2Array
        } else {
            TextureViewDimension::D2
        };
        match class {
            ImageClass::Sampled { kind, multi: false } => BindingType::Texture {
                sample_type: match kind {
                    naga::ScalarKind::Float => TextureSampleType::Float { filterable: false },
                    naga::ScalarKind::Uint => TextureSampleType::Uint,
                    kind => panic!("{kind:?}"),
                },
                view_dimension,
                multisampled: false,
            },
            ImageClass::Storage { format, access } => {
                assert_eq!(access, StorageAccess::STORE);
                BindingType::StorageTexture {
                    access: StorageTextureAccess::WriteOnly,
                    format: match format {
                        naga::StorageFormat::R32Float => TextureFormat::R32Float,
                        naga::StorageFormat::Rg32Float => TextureFormat::Rg32Float,
                        naga::StorageFormat::Rgba16Float => TextureFormat::Rgba16Float,
                        naga::StorageFormat::Rgba32Float => TextureFormat::Rgba32Float,
                        naga::StorageFormat::R32Uint => TextureFormat::R32Uint,
                        naga::StorageFormat::Rgba32Uint => TextureFormat::Rgba32Uint,
                        format => panic!("{format:?}"),
                    },
                    view_dimension,
                }
            }
            class => panic!("{class:?}"),
        }
    }

    /// Variables, entry points and what these use, of each of the crate's modules.
    #[test]
    fn interfaces_are_those_that_naga_finds() {
        for effect in effects() {
            for shader in shaders(&effect).expect("well-formed directives") {
                let name = &shader.name;
                let module = naga::front::wgsl::parse_str(&shader.source).expect("valid WGSL");
                let info = naga::valid::Validator::new(
                    naga::valid::ValidationFlags::all(),
                    naga::valid::Capabilities::all(),
                )
                .subgroup_stages(naga::valid::ShaderStages::all())
                .subgroup_operations(naga::valid::SubgroupOperationSet::all())
                .validate(&module)
                .expect("valid WGSL");
                let interface = Interface::of(&shader.source);
                let mut found = interface.variables.clone();
                let mut expected: Vec<_> = module
                    .global_variables
                    .iter()
                    .filter_map(|(_, variable)| {
                        let at = variable.binding?;
                        Some(Variable {
                            name: variable.name.clone()?,
                            group: at.group,
                            binding: at.binding,
                            ty: naga_type(&module, variable),
                        })
                    })
                    .collect();
                for all in [&mut found, &mut expected] {
                    all.sort_by_key(|v| (v.group, v.binding, v.name.clone()));
                }
                assert_eq!(found, expected, "{name}");
                let mut entries: Vec<_> =
                    module.entry_points.iter().map(|e| e.name.clone()).collect();
                entries.sort();
                assert_eq!(interface.entries().collect::<Vec<_>>(), entries, "{name}");
                for (index, entry) in module.entry_points.iter().enumerate() {
                    let stage = match entry.stage {
                        ShaderStage::Vertex => ShaderStages::VERTEX,
                        ShaderStage::Fragment => ShaderStages::FRAGMENT,
                        _ => ShaderStages::COMPUTE,
                    };
                    for (handle, variable) in module.global_variables.iter() {
                        let (Some(_), Some(variable)) = (variable.binding, &variable.name) else {
                            continue;
                        };
                        let uses = !info.get_entry_point(index)[handle].is_empty();
                        let expected = if uses { stage } else { ShaderStages::empty() };
                        let found = interface.stages(variable, &[&entry.name]);
                        assert_eq!(found, expected, "{name}: {variable} in {}", entry.name);
                    }
                }
            }
        }
    }
}
