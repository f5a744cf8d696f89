//! What surfaces reflect and emit.

use std::{f32::consts::PI, io::Cursor};

use deep_screen_space::scenes::{Material, Scene};
use image::{ImageFormat, Rgb, RgbImage};
use serde_json::json;

use super::files::{File, UNSIGNED_SHORT, assert_sound, near_origin, square};

/// A square whose material is this.
fn of_material(material: serde_json::Value) -> File {
    let mut file = square();
    file.push("materials", material);
    file.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    file
}

fn only(scene: &Scene) -> Material {
    assert_sound(scene);
    assert_eq!(scene.materials.len(), 1, "{:?}", scene.materials);
    scene.materials[0]
}

#[track_caller]
fn assert_close(found: [f32; 3], expected: [f32; 3]) {
    let close = |(f, e): (f32, f32)| (f - e).abs() <= 1e-5 * e.abs() + 1e-7;
    assert!(
        found.into_iter().zip(expected).all(close),
        "{found:?}, not {expected:?}"
    );
}

/// A radiance of the file is a radiosity of the scene; its strength multiplies it, and it is of both sides where it says so.
#[test]
fn emission_has_a_strength_and_sides() {
    let plain = only(&square().scene());
    assert_eq!(
        (plain.albedo, plain.emission, plain.double_sided),
        ([1.0; 3], [0.0; 3], false)
    );
    for strength in [None, Some(10.0_f32)] {
        for double_sided in [false, true] {
            let mut material =
                json!({ "emissiveFactor": [1.0, 0.5, 0.0], "doubleSided": double_sided });
            if let Some(strength) = strength {
                material["extensions"] =
                    json!({ "KHR_materials_emissive_strength": { "emissiveStrength": strength } });
            }
            let found = only(&of_material(material).scene());
            let s = PI * strength.unwrap_or(1.0);
            assert_close(found.emission, [s, 0.5 * s, 0.0]);
            assert_eq!(found.double_sided, double_sided);
        }
    }
}

/// Two texels, black and white, as a PNG in the buffer.
fn add_texture(file: &mut File, texels: &[[u8; 3]], format: ImageFormat) -> usize {
    let mut image = RgbImage::new(texels.len() as u32, 1);
    for (x, texel) in texels.iter().enumerate() {
        image.put_pixel(x as u32, 0, Rgb(*texel));
    }
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).expect("an image");
    let view = file.view(&bytes.into_inner());
    let kind = if format == ImageFormat::Png {
        "image/png"
    } else {
        "image/jpeg"
    };
    let source = file.push("images", json!({ "bufferView": view, "mimeType": kind }));
    file.push("textures", json!({ "source": source }))
}

fn texture_coordinates(file: &mut File, coordinates: [[f32; 2]; 4]) {
    let accessor = file.floats(&coordinates);
    file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(accessor);
}

const ALL: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

fn at(u: f32) -> [[f32; 2]; 4] {
    [[u, 0.5]; 4]
}

/// What glows is what its texture shows there, not the whole body.
#[test]
fn emissive_textures_glow_where_they_say() {
    for format in [ImageFormat::Png, ImageFormat::Jpeg] {
        for (coordinates, expected) in [(at(0.25), 0.0), (at(0.75), 1.0)] {
            let mut file = of_material(json!({ "emissiveFactor": [1, 1, 1] }));
            // Wide, so that a JPEG's blocks do not mix them.
            let texels = [[[0; 3]; 32], [[255; 3]; 32]].concat();
            let texture = add_texture(&mut file, &texels, format);
            file.json["materials"][0]["emissiveTexture"] = json!({ "index": texture });
            texture_coordinates(&mut file, coordinates);
            assert_close(only(&file.scene()).emission, [expected * PI; 3]);
        }
    }
    // One triangle in the black half, one in the white one: two materials; the power is what the texture's is.
    let mut file = of_material(json!({ "emissiveFactor": [1, 1, 1] }));
    let texture = add_texture(&mut file, &[[0; 3], [255; 3]], ImageFormat::Png);
    file.json["materials"][0]["emissiveTexture"] = json!({ "index": texture });
    let positions = file.floats(&[
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [5.0, 0.0, 0.0],
        [6.0, 0.0, 0.0],
        [5.0, 1.0, 0.0],
    ]);
    let coordinates = file.floats(&[
        [0.1, 0.5],
        [0.2, 0.5],
        [0.3, 0.5],
        [0.7, 0.5],
        [0.8, 0.5],
        [0.9, 0.5],
    ]);
    file.json["meshes"][0]["primitives"][0] = json!({
        "attributes": { "POSITION": positions, "TEXCOORD_0": coordinates },
        "material": 0,
    });
    let scene = file.scene();
    assert_sound(&scene);
    for (part, corner) in scene
        .parts
        .iter()
        .map(|p| (p, scene.indices[p.first_index as usize]))
    {
        let lit = scene.positions[corner as usize][0] >= 5.0;
        let emission = scene.materials[part.material as usize].emission;
        assert_close(emission, [if lit { PI } else { 0.0 }; 3]);
    }
    assert_eq!(scene.parts.len(), 2);
}

/// A texture that cannot be read is noted; what it would light up stays dark, and what it would colour is as its factor.
#[test]
fn textures_that_cannot_be_read_are_noted() {
    let broken = |file: &mut File| {
        let view = file.view(b"no image at all");
        file.push(
            "images",
            json!({ "bufferView": view, "mimeType": "image/png" }),
        )
    };
    let missing = |file: &mut File| file.push("images", json!({ "uri": "missing.png" }));
    let makers: [&dyn Fn(&mut File) -> usize; 2] = [&broken, &missing];
    for make in makers {
        let mut file = of_material(json!({ "emissiveFactor": [1, 1, 1] }));
        let source = make(&mut file);
        let texture = file.push("textures", json!({ "source": source }));
        let material = &mut file.json["materials"][0];
        material["emissiveTexture"] = json!({ "index": texture });
        material["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": texture }, "baseColorFactor": [0.5, 0.25, 1, 1] });
        texture_coordinates(&mut file, ALL);
        let loaded = file.read().expect("a square");
        let found = only(&near_origin(loaded.world));
        assert_close(found.emission, [0.0; 3]);
        assert_close(found.albedo, [0.5, 0.25, 1.0]);
        assert_eq!(loaded.notes.len(), 1, "{:?}", loaded.notes);
        assert!(
            loaded.notes[0].starts_with("image 0 is left out"),
            "{:?}",
            loaded.notes
        );
    }
    // One that only an extension has a source for.
    let mut file = of_material(json!({ "emissiveFactor": [1, 1, 1] }));
    file.push(
        "textures",
        json!({ "extensions": { "KHR_texture_basisu": { "source": 0 } } }),
    );
    file.json["materials"][0]["emissiveTexture"] = json!({ "index": 0 });
    let loaded = file.read().expect("a square");
    assert_close(only(&near_origin(loaded.world)).emission, [0.0; 3]);
    assert!(loaded.notes[0].contains("texture 0"), "{:?}", loaded.notes);
}

/// The mean over a triangle in linear light: half of it white is 0.5, not what half of 255 stands for; wherever the texture
/// repeats, and as its transform has it.
#[test]
fn base_colours_are_means_in_linear_light() {
    let of = |coordinates: [[f32; 2]; 4], info: serde_json::Value, sampler: serde_json::Value| {
        let mut file = of_material(json!({
            "pbrMetallicRoughness": { "baseColorFactor": [0.5, 1.0, 1.0, 1.0] },
        }));
        let texture = add_texture(&mut file, &[[0; 3], [255; 3]], ImageFormat::Png);
        file.push("samplers", sampler);
        file.json["textures"][texture]["sampler"] = json!(0);
        let mut info = info;
        info["index"] = json!(texture);
        file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = info;
        file.json["extensionsUsed"] = json!(["KHR_texture_transform"]);
        texture_coordinates(&mut file, coordinates);
        let scene = file.scene();
        assert_sound(&scene);
        // Both triangles together.
        let mean = scene.parts.iter().fold(0.0, |sum, part| {
            let share = part.index_count as f32 / scene.indices.len() as f32;
            sum + share * scene.materials[part.material as usize].albedo[1]
        });
        let [r, g, b] = scene.materials[0].albedo;
        assert!((2.0 * r - g).abs() < 1e-6 && g == b);
        mean
    };
    let none = || json!({});
    // Steps of the points at which the texture is read.
    assert!(
        (of(ALL, none(), none()) - 0.5).abs() < 0.07,
        "{}",
        of(ALL, none(), none())
    );
    let repeated = ALL.map(|[u, v]| [64.0 * u - 7.0, 64.0 * v]);
    assert!((of(repeated, none(), none()) - 0.5).abs() < 0.07);
    let (clamp, mirror) = (json!({ "wrapS": 33071 }), json!({ "wrapS": 33648 }));
    for (u, repeat, clamped, mirrored) in [
        (1.25, 0.0, 1.0, 1.0),
        (-0.25, 1.0, 0.0, 0.0),
        (2.75, 1.0, 1.0, 1.0),
    ] {
        assert_eq!(of(at(u), none(), none()), repeat);
        assert_eq!(of(at(u), none(), clamp.clone()), clamped);
        assert_eq!(of(at(u), none(), mirror.clone()), mirrored);
    }
    let moved = json!({ "extensions": { "KHR_texture_transform": { "offset": [0.5, 0.0] } } });
    assert_eq!(of(at(0.25), moved.clone(), none()), 1.0);
    assert_eq!(of(at(0.75), moved, none()), 0.0);
    // A quarter turn: what v says is then what u says.
    let turned = json!({ "extensions": { "KHR_texture_transform": { "rotation": std::f64::consts::FRAC_PI_2 } } });
    let v = |v: f32| [[0.5, v]; 4];
    assert_eq!(of(v(0.25), turned.clone(), none()), 0.0);
    assert_eq!(of(v(0.75), turned, none()), 1.0);
}

/// Stored values are sRGB: dark ones are a twelfth of what they say, others a power of it.
#[test]
fn textures_are_srgb() {
    let mut file = of_material(json!({ "emissiveFactor": [1, 1, 1] }));
    let texture = add_texture(&mut file, &[[10, 128, 255]], ImageFormat::Png);
    file.json["materials"][0]["emissiveTexture"] = json!({ "index": texture });
    texture_coordinates(&mut file, ALL);
    assert_close(
        only(&file.scene()).emission,
        [0.003_035_27, 0.215_860_5, 1.0].map(|c| c * PI),
    );
}

/// Colours of vertices multiply the base colour; groups of triangles keep their mean.
#[test]
fn colours_of_vertices() {
    let mut file = square();
    let white = [u16::MAX; 4];
    let grey = [u16::MAX / 5, 0, u16::MAX, u16::MAX];
    let bytes: Vec<u8> = [white, grey, white, grey]
        .iter()
        .flatten()
        .flat_map(|c| c.to_le_bytes())
        .collect();
    let colors = file.accessor(UNSIGNED_SHORT, "VEC4", 4, &bytes);
    file.json["accessors"][colors]["normalized"] = json!(true);
    file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    // Two of each triangle's corners are white.
    assert_close(only(&file.scene()).albedo, [2.2 / 3.0, 2.0 / 3.0, 1.0]);
}

/// However many colours there are, a primitive becomes few parts.
#[test]
fn many_colours_become_few_parts() {
    let mut file = File::new();
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
    for i in 0..3000_u32 {
        let x = i as f32;
        positions.extend([[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]]);
        let step = |factor: u32| (i * factor % 251) as f32 / 250.0;
        colors.extend([[step(7), step(13), step(29)]; 3]);
    }
    let mean: f32 = colors.iter().map(|c| c[0]).sum::<f32>() / colors.len() as f32;
    let positions = file.floats(&positions);
    let colors = file.floats(&colors);
    file.show(&json!({ "attributes": { "POSITION": positions, "COLOR_0": colors } }));
    let scene = file.scene();
    assert_sound(&scene);
    assert_eq!(scene.triangle_count(), 3000);
    assert!(
        (2..=64).contains(&scene.parts.len()),
        "{}",
        scene.parts.len()
    );
    let found: f32 = scene
        .parts
        .iter()
        .map(|p| p.index_count as f32 / 9000.0 * scene.materials[p.material as usize].albedo[0])
        .sum();
    assert!((found - mean).abs() < 1e-4, "{found} {mean}");
}
