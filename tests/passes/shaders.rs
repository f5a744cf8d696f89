//! Every WGSL variant parses and validates without a GPU, with exactly the capabilities that it asks for. Those that hold all
//! pairs of flags are left in `target/wgsl` for `scripts/browser_check.py`.

use std::{
    collections::{BTreeMap, BTreeSet, HashSet},
    fs,
    path::Path,
};

use deep_screen_space::{
    AmbientOcclusion, BentNormals, DiffuseBounce, DirectionalOcclusion, Effect, Error, Overlap,
    Scattering, Shader, SpecularBounce, SubsurfaceScattering, shaders, wgpu::Features,
};
use naga::valid::{Capabilities, ShaderStages, SubgroupOperationSet, ValidationFlags, Validator};

/// An effect that uses everything an effect can.
fn everything() -> Effect {
    Effect {
        channels: 3,
        materials: true,
        albedo: true,
        two_sided: true,
        ..Effect::new(
            "everything",
            "
fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  return sender.radius / epsilon;
}
fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> vec3f {
  return sender.material.emission * sender.material.albedo * max(dot(receiver_normal, to_sender), 0.0);
}
fn resolve(sum: vec3f, albedo: vec3f) -> vec4f {
  return vec4f(sum * albedo, 1.0);
}
",
        )
    }
}

/// Eight channels of three effects in one, which read all that surfels send.
fn all_channels() -> Effect {
    let bounce = DiffuseBounce::default().effect().expect("a unit");
    let occlusion = AmbientOcclusion::default().effect();
    let joined = everything()
        .and(&bounce)
        .and_then(|both| both.and(&occlusion));
    let joined = joined.and_then(|all| all.and(&occlusion));
    joined.expect("eight channels")
}

/// Two of whom one asks for an environment, the other for view and roughness.
fn under_sky_and_glossy() -> Effect {
    let glossy = SpecularBounce {
        two_sided: true,
        ..SpecularBounce::default()
    };
    let glossy = glossy.effect().expect("a unit");
    let sky = DirectionalOcclusion::default().effect();
    sky.and(&glossy).expect("six channels")
}

/// Those that do not follow the effect stand once.
fn variants() -> Vec<Shader> {
    let mut all: Vec<Shader> = Vec::new();
    let mut sources = HashSet::new();
    for effect in [
        AmbientOcclusion::default().effect(),
        AmbientOcclusion {
            two_sided: true,
            overlap: Overlap::Independent,
            own_surface: true,
        }
        .effect(),
        everything(),
        SubsurfaceScattering::new(Scattering::MARBLE)
            .effect()
            .expect("a material"),
        all_channels(),
        BentNormals::default().effect(),
        DirectionalOcclusion::default().effect(),
        SpecularBounce::default().effect().expect("a unit"),
        under_sky_and_glossy(),
    ] {
        for shader in shaders(&effect).expect("well-formed directives") {
            if !sources.insert(shader.source.clone()) {
                continue;
            }
            let name = format!(
                "{} for {}{}",
                shader.name,
                effect.label,
                if effect.two_sided { " two-sided" } else { "" }
            );
            all.push(Shader { name, ..shader });
        }
    }
    all
}

fn validate(shader: &Shader, capabilities: Capabilities) -> Result<(), String> {
    let module = naga::front::wgsl::parse_str(&shader.source)
        .map_err(|e| e.emit_to_string(&shader.source))?;
    Validator::new(ValidationFlags::all(), capabilities)
        .subgroup_stages(ShaderStages::COMPUTE)
        .subgroup_operations(SubgroupOperationSet::all())
        .validate(&module)
        .map(|_| ())
        .map_err(|e| e.emit_to_string(&shader.source))
}

/// The fewest variants of each file, or nearly, in which any two words of the variants' names stand together, apart, and both
/// not at all, where they do in any: a browser takes long to compile one, and what it refuses hangs on two flags at most.
fn covering(shaders: Vec<Shader>) -> Vec<Shader> {
    let mut files: BTreeMap<String, Vec<Shader>> = BTreeMap::new();
    for shader in shaders {
        let file = shader.name.split(' ').next().unwrap_or_default();
        files.entry(file.to_owned()).or_default().push(shader);
    }
    let mut covering = Vec::new();
    for mut shaders in files.into_values() {
        let words: BTreeSet<String> = shaders
            .iter()
            .flat_map(|shader| shader.name.split(' ').map(str::to_owned))
            .collect();
        let pairs = |shader: &Shader| -> BTreeSet<[(usize, bool); 2]> {
            let own: HashSet<&str> = shader.name.split(' ').collect();
            let is = |i: usize, word: &String| (i, own.contains(word.as_str()));
            let all: Vec<_> = words.iter().enumerate().map(|(i, w)| is(i, w)).collect();
            let pair = |&a| all.iter().map(move |&b| [a, b]);
            all.iter().flat_map(pair).collect()
        };
        let mut missing: BTreeSet<_> = shaders.iter().flat_map(pairs).collect();
        while !missing.is_empty() {
            let gain = |shader: &Shader| pairs(shader).intersection(&missing).count();
            let (best, _) = shaders
                .iter()
                .enumerate()
                .max_by_key(|(_, shader)| gain(shader))
                .expect("what is missing is in one of them");
            let best = shaders.swap_remove(best);
            missing = &missing - &pairs(&best);
            covering.push(best);
        }
    }
    covering
}

/// `unpack2x16float`: part of WebGPU itself, lacking only on downlevel devices (`DownlevelFlags::SHADER_F16_IN_F32`).
const FLOOR: Capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32;

fn capabilities(features: Features) -> Capabilities {
    let mut capabilities = FLOOR;
    capabilities.set(
        Capabilities::SUBGROUP,
        features.contains(Features::SUBGROUP),
    );
    capabilities.set(
        Capabilities::RAY_QUERY,
        features.contains(Features::EXPERIMENTAL_RAY_QUERY),
    );
    capabilities
}

#[test]
fn every_variant_validates_with_the_capabilities_it_asks_for() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../wgsl");
    fs::create_dir_all(&folder).expect("target can be written");
    let mut all = variants();
    for shader in &all {
        if let Err(problem) = validate(shader, capabilities(shader.features)) {
            panic!("{}:\n{problem}", shader.name);
        }
    }
    // No browser has these.
    all.retain(|shader| !shader.features.contains(Features::EXPERIMENTAL_RAY_QUERY));
    for shader in covering(all) {
        let header = if shader.features.contains(Features::SUBGROUP) {
            "// requires: subgroups\n"
        } else {
            ""
        };
        // Whole at once: other runs may be writing the same, and a browser reading it.
        let file = folder.join(format!("{}.wgsl", shader.name.replace(' ', "_")));
        let part = file.with_extension(std::process::id().to_string());
        fs::write(&part, format!("{header}{}", shader.source)).expect("target can be written");
        fs::rename(part, file).expect("target can be written");
    }
}

#[test]
fn features_are_neither_missing_nor_superfluous() {
    for shader in variants() {
        let without = validate(&shader, FLOOR);
        assert_eq!(
            without.is_err(),
            !shader.features.is_empty(),
            "{}",
            shader.name
        );
    }
}

#[test]
fn malformed_effects_are_typed_errors() {
    for (source, problem) in [
        ("#if MATERIAL\n", "has #if without #endif, in line 1"),
        ("\n#endif\n", "has #endif without #if, in line 2"),
        ("#else\n", "has #else without #if, in line 1"),
        (
            "#import nothing\n",
            "imports \"nothing\", which there is not, in line 1",
        ),
        (
            "#ifdef MATERIAL\n",
            "has the unknown directive #ifdef, in line 1",
        ),
    ] {
        let effect = Effect {
            source: source.into(),
            ..everything()
        };
        let expected = Error::Effect {
            label: "everything".into(),
            problem: problem.into(),
        };
        assert_eq!(shaders(&effect), Err(expected), "{source}");
    }
}

/// A file that no pass lists would be validated by nothing.
#[test]
fn every_file_is_a_shader() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("wgsl");
    let all = variants();
    let mut files = 0;
    for entry in fs::read_dir(folder).expect("the folder wgsl") {
        let path = entry.expect("an entry").path();
        let Some("wgsl") = path.extension().and_then(|e| e.to_str()) else {
            continue;
        };
        files += 1;
        let name = path.file_stem().expect("a name").to_string_lossy();
        assert!(
            all.iter()
                .any(|s| s.name.split(' ').next() == Some(name.as_ref())),
            "{name}.wgsl is not among the shaders"
        );
    }
    assert!(files > 0);
}
