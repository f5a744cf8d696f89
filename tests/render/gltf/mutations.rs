//! Good files with something changed at random: each is read or refused with one line, soon and without a panic.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::{
    files::{File, UNSIGNED_BYTE, assert_sound, binary, near_origin, read, square},
    uris::base64,
};

/// How many files, where the environment does not say.
const FILES: u64 = 6000;
/// The environment's word for it.
const VARIABLE: &str = "DSS_GLTF_MUTATIONS";
/// What reading one may take: measured 30 ms at most, where other programs run too.
const LONGEST: Duration = Duration::from_secs(30);
/// What the whole process may have taken of memory, in KiB: each file has room for 65 536 corners.
const MOST_MEMORY: u64 = 1 << 20;

/// The same numbers from the same seed.
struct Random(u64);

impl Random {
    /// splitmix64 (Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators").
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn pick<T: Clone>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())].clone()
    }
}

/// Files that have, together, all that is read.
fn seeds() -> Vec<File> {
    let mut textured = square();
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_fn(4, 4, |x, y| image::Rgb([60 * x as u8, 60 * y as u8, 9]))
        .write_to(&mut png, image::ImageFormat::Png)
        .expect("an image");
    let view = textured.view(&png.into_inner());
    textured.push(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    );
    textured.push("samplers", json!({ "wrapS": 33071, "wrapT": 33648 }));
    textured.push("textures", json!({ "source": 0, "sampler": 0 }));
    let transform = json!({ "KHR_texture_transform": { "offset": [0.5, 0.25], "rotation": 1.0, "scale": [2, 3] } });
    textured.push(
        "materials",
        json!({
            "doubleSided": true,
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0, "extensions": transform } },
            "emissiveFactor": [1, 1, 1],
            "emissiveTexture": { "index": 0 },
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 5.0 } },
        }),
    );
    let coordinates = textured.floats(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let colors = textured.floats(&[[0.5_f32; 4]; 4]);
    let primitive = &mut textured.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["TEXCOORD_0"] = json!(coordinates);
    primitive["attributes"]["COLOR_0"] = json!(colors);
    primitive["material"] = json!(0);

    let mut moved = square();
    let joints = moved.accessor(UNSIGNED_BYTE, "VEC4", 4, &[0, 1, 0, 1].repeat(4));
    let weights = moved.floats(&[[0.5, 0.25, 0.25, 0.0]; 4]);
    let matrices = moved.floats(&[[1.0_f32; 16]; 2]);
    let step = moved.floats(&[[0.0, 0.0, 1.0]; 4]);
    let primitive = &mut moved.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["JOINTS_0"] = json!(joints);
    primitive["attributes"]["WEIGHTS_0"] = json!(weights);
    primitive["targets"] = json!([{ "POSITION": step, "NORMAL": step }]);
    moved.json["meshes"][0]["weights"] = json!([0.5]);
    let joint = moved.node(json!({ "children": [2], "rotation": [0.0, 0.6, 0.0, 0.8] }));
    moved.push("nodes", json!({ "scale": [1, 2, 1] }));
    moved.push(
        "skins",
        json!({ "joints": [joint, 2], "inverseBindMatrices": matrices, "skeleton": joint }),
    );
    moved.json["nodes"][0]["skin"] = json!(0);

    let mut placed = square();
    let places = placed.view(&[1, 3]);
    let values = placed.view(&[0; 24]);
    placed.json["accessors"][0]["sparse"] = json!({
        "count": 2,
        "indices": { "bufferView": places, "componentType": UNSIGNED_BYTE },
        "values": { "bufferView": values },
    });
    let translations = placed.floats(&[[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]);
    let rotations = placed.floats(&[[0.0, 0.6, 0.0, 0.8]; 2]);
    placed.json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": {
        "attributes": { "TRANSLATION": translations, "ROTATION": rotations, "SCALE": translations },
    } });
    placed.json["extensionsUsed"] = json!([
        "EXT_mesh_gpu_instancing",
        "KHR_lights_punctual",
        "KHR_mesh_quantization"
    ]);
    placed.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    placed.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "spot", "intensity": 5.0, "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.5 } },
        { "type": "directional", "color": [1.0, 0.5, 0.0] },
    ] } });
    placed.push(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1, "aspectRatio": 2.0 } }),
    );
    placed.node(json!({ "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
    placed.node(json!({ "extensions": { "KHR_lights_punctual": { "light": 1 } }, "translation": [1, 2, 3] }));
    placed.json["meshes"][0]["primitives"][0]["mode"] = json!(5);

    let mut named = square();
    let uri = format!(
        "data:application/octet-stream;base64,{}",
        base64(&named.bytes)
    );
    named.json["buffers"] = json!([{ "byteLength": named.bytes.len(), "uri": uri }]);
    let seeds = vec![square(), textured, moved, placed, named];
    for seed in &seeds {
        assert_sound(&seed.scene());
    }
    seeds
}

/// Every place in a JSON value, as pointers.
fn places(value: &Value, at: &str, found: &mut Vec<String>) {
    let inner: Vec<(String, &Value)> = match value {
        Value::Array(list) => list
            .iter()
            .enumerate()
            .map(|(i, v)| (i.to_string(), v))
            .collect(),
        Value::Object(map) => map
            .iter()
            .map(|(k, v)| (k.replace('~', "~0").replace('/', "~1"), v))
            .collect(),
        _ => Vec::new(),
    };
    for (key, value) in inner {
        let place = format!("{at}/{key}");
        places(value, &place, found);
        found.push(place);
    }
}

/// What a value becomes: mostly one of its own type, so that more than the parser has work.
fn any_value(random: &mut Random, value: &Value, other: Value) -> Value {
    let near = random.below(8);
    let numbers = [
        json!(near),
        json!(near),
        json!(near),
        json!(3 * near),
        json!(255),
        json!(65_536),
        json!(u32::MAX),
        json!(1_u64 << 32),
        json!(1_u64 << 53),
        json!(u64::MAX),
        json!(5120 + near),
        json!(5120 + near),
    ];
    let fractions = [
        json!(-1),
        json!(0.5),
        json!(1e30),
        json!(-1e38),
        json!(1e39),
        json!(1e300),
    ];
    let words = [
        "SCALAR", "VEC2", "VEC3", "VEC4", "MAT4", "point", "a\nb", "%FF", "data:,", "missing",
    ];
    if random.below(8) == 0 {
        return random.pick(&[
            Value::Null,
            json!([]),
            json!({}),
            json!("VEC3"),
            json!(1),
            other,
        ]);
    }
    match value {
        Value::Number(n) if n.is_f64() && random.below(2) == 0 => random.pick(&fractions),
        Value::Number(_) if random.below(8) == 0 => random.pick(&fractions),
        Value::Number(_) => random.pick(&numbers),
        Value::String(_) => json!(random.pick(&words)),
        Value::Bool(b) => json!(!b),
        Value::Null => other,
        // An element twice, or one less.
        Value::Array(list) => {
            let mut list = list.clone();
            if let Some(element) = list.get(random.below(list.len())).cloned() {
                list.push(element);
            }
            if random.below(2) == 0 {
                list.pop();
                list.pop();
            }
            json!(list)
        }
        Value::Object(map) => {
            let mut map = map.clone();
            let keys: Vec<String> = map.keys().cloned().collect();
            if !keys.is_empty() {
                map.remove(&random.pick(&keys));
            }
            json!(map)
        }
    }
}

/// Changes one place of a file's JSON.
fn change(json: &mut Value, random: &mut Random) {
    let mut all = Vec::new();
    places(json, "", &mut all);
    let (place, other) = (random.pick(&all), random.pick(&all));
    let other = json.pointer(&other).cloned().unwrap_or_default();
    let Some((above, key)) = place.rsplit_once('/') else {
        return;
    };
    let kind = random.below(12);
    let Some(value) = json.pointer(&place).cloned() else {
        return;
    };
    let value = any_value(random, &value, other.clone());
    match json.pointer_mut(above) {
        Some(Value::Object(map)) if kind == 0 => {
            map.remove(key);
        }
        Some(Value::Array(list)) if kind == 0 => {
            let i = random.below(list.len());
            list.remove(i);
        }
        Some(Value::Array(list)) if kind == 1 => list.push(other),
        Some(Value::Object(map)) if kind == 1 => {
            map.insert("extensions".into(), other);
        }
        _ => {
            if let Some(inner) = json.pointer_mut(&place) {
                *inner = value;
            }
        }
    }
}

/// Overwrites words of the buffer.
fn scribble(bytes: &mut [u8], random: &mut Random) {
    let words = [
        f32::NAN,
        f32::INFINITY,
        -f32::MAX,
        f32::MIN_POSITIVE,
        0.0,
        1.0,
        -1e30,
    ];
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len() / 4) * 4;
        let word = if random.below(2) == 0 {
            random.pick(&words).to_le_bytes()
        } else {
            (random.next() as u32).to_le_bytes()
        };
        if let Some(place) = bytes.get_mut(at..at + 4) {
            place.copy_from_slice(&word);
        }
    }
}

fn mutated(seed: &File, random: &mut Random) -> Vec<u8> {
    let mut file = seed.clone();
    if file.json.get("buffers").is_none() {
        file.json["buffers"] = json!([{ "byteLength": file.bytes.len() }]);
    }
    let ways = random.below(16);
    if ways != 0 {
        for _ in 0..=random.below(2) {
            change(&mut file.json, random);
        }
    }
    if ways.is_multiple_of(4) {
        scribble(&mut file.bytes, random);
    }
    let mut text = file.json.to_string().into_bytes();
    // Text that JSON may not survive.
    if ways == 7 {
        for _ in 0..=random.below(3) {
            let at = random.below(text.len());
            text[at] = random.pick(b"0123456789-eE.,:[]{}\"\\ \x00\xff");
        }
    }
    let mut bytes = if ways == 6 {
        text
    } else {
        binary(&text, &file.bytes)
    };
    match random.below(40) {
        0 => bytes.truncate(random.below(bytes.len() + 1)),
        1 => bytes.extend([0; 7]),
        2 => {
            let at = random.below(bytes.len());
            bytes[at] ^= 1 << random.below(8);
        }
        3 => {
            let at = random.below(bytes.len().min(28));
            bytes[at] = random.next() as u8;
        }
        _ => {}
    }
    bytes
}

/// The most memory that this process has had, in KiB, where the system says.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

#[test]
fn mutated_files_are_read_or_refused() {
    let files = std::env::var(VARIABLE)
        .ok()
        .map_or(FILES, |text| text.parse().expect("a number"));
    let seeds = seeds();
    let (mut good, mut longest) = (0, Duration::ZERO);
    let mut reasons = std::collections::BTreeMap::new();
    for number in 0..files {
        let mut random = Random(number);
        let seed = &seeds[random.below(seeds.len())];
        let bytes = mutated(seed, &mut random);
        let start = Instant::now();
        let found = std::panic::catch_unwind(|| read(&bytes));
        let took = start.elapsed();
        longest = longest.max(took);
        assert!(took < LONGEST, "file {number} took {took:?}");
        match found.unwrap_or_else(|_| panic!("file {number} panics")) {
            Ok(loaded) => {
                good += 1;
                assert_sound(&near_origin(loaded.world));
                assert!(
                    loaded.notes.iter().all(|note| !note.contains('\n')),
                    "file {number}"
                );
            }
            Err(problem) => {
                let whole = !problem.is_empty() && !problem.contains('\n');
                assert!(
                    whole && problem.chars().count() <= 401,
                    "file {number}: {problem}"
                );
                let kind: String = problem
                    .chars()
                    .filter(|c| !c.is_ascii_digit())
                    .take(60)
                    .collect();
                *reasons.entry(kind).or_insert(0_u32) += 1;
            }
        }
    }
    let memory = peak_memory();

    println!(
        "{good} of {files} are read, {} reasons, {longest:?} at most, {memory:?} KiB",
        reasons.len()
    );
    // Neither all nor none: the changes are neither harmless nor always in the same place.
    assert!(
        good > files / 20 && good < files * 19 / 20,
        "{good} of {files}"
    );
    assert!(reasons.len() > 30, "{reasons:?}");
    assert!(memory.is_none_or(|kib| kib < MOST_MEMORY), "{memory:?}");
}
