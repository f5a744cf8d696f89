//! Alpha masks: which materials have holes, and that what has them is drawn and compared with them.

use std::io::Cursor;

use deep_screen_space::AlphaWrap;
use image::{ImageFormat, Rgba, RgbaImage};
use serde_json::json;

use super::files::{File, assert_sound, square};
use crate::{folder, render, rmse};

/// Half of it clear, and of such a colour there, half solid, as a PNG in the buffer.
fn add_picture(file: &mut File, clear: [u8; 3]) -> usize {
    let [r, g, b] = clear;
    let image = RgbaImage::from_fn(8, 4, |x, _| {
        Rgba(if x < 4 {
            [r, g, b, 0]
        } else {
            [200, 100, 50, 255]
        })
    });
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("an image");
    let view = file.view(&bytes.into_inner());
    let source = file.push(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    );
    let sampler = file.push("samplers", json!({ "wrapS": 33071, "wrapT": 33648 }));
    file.push("textures", json!({ "source": source, "sampler": sampler }))
}

fn masked(mode: &str, cutoff: Option<f64>, opacity: f64) -> File {
    masked_and_clear(mode, cutoff, opacity, [200, 100, 50])
}

fn masked_and_clear(mode: &str, cutoff: Option<f64>, opacity: f64, clear: [u8; 3]) -> File {
    let mut file = square();
    let texture = add_picture(&mut file, clear);
    let accessor = file.floats(&[[0.0_f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let primitive = &mut file.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["TEXCOORD_0"] = json!(accessor);
    let mut material = json!({
        "alphaMode": mode,
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": texture },
            "baseColorFactor": [1.0, 1.0, 1.0, opacity],
        },
    });
    if let Some(cutoff) = cutoff {
        material["alphaCutoff"] = json!(cutoff);
    }
    file.push("materials", material);
    file.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    file
}

/// What is cut out has no colour: whatever is in the picture there, the rest has the same albedo.
#[test]
fn colors_are_of_what_is_there() {
    let albedo = |mode, clear| {
        let scene = masked_and_clear(mode, None, 1.0, clear).scene();
        let used = scene.parts.iter().map(|part| part.material as usize);
        used.map(|i| scene.materials[i].albedo).collect::<Vec<_>>()
    };
    let solid = albedo("MASK", [200, 100, 50]);
    for clear in [[0; 3], [255; 3]] {
        let found = albedo("MASK", clear);
        assert_eq!(found.len(), solid.len());
        for (found, solid) in found.iter().zip(&solid) {
            let near = |c: usize| (found[c] - solid[c]).abs() < 1e-6;
            assert!((0..3).all(near), "{found:?}, {solid:?}");
        }
        // All of an opaque one counts.
        assert_ne!(albedo("OPAQUE", clear), solid);
    }
}

#[test]
fn masks_have_the_files_thresholds_and_wraps() {
    for (cutoff, opacity, threshold) in [
        (None, 1.0, 0.5),
        (Some(0.25), 0.5, 0.5),
        (Some(0.9), 1.0, 0.9),
    ] {
        let scene = masked("MASK", cutoff, opacity).scene();
        assert_sound(&scene);
        let holes = scene.holes.as_ref().expect("holes");
        assert_eq!(holes.size, [8, 4]);
        assert_eq!(holes.tex_coords.len(), scene.positions.len());
        let [Some(test)] = holes.tests[..] else {
            panic!("{:?}", holes.tests);
        };
        assert!((test.threshold - threshold).abs() < 1e-6, "{test:?}");
        assert_eq!(test.wrap, [AlphaWrap::ClampToEdge, AlphaWrap::MirrorRepeat]);
        assert_eq!((holes.maps[0][3], holes.maps[0][4]), (0, 255));
    }
    // None of it is there, or all of it, or it is not a mask.
    assert!(masked("MASK", Some(0.0), 1.0).scene().holes.is_none());
    assert!(masked("OPAQUE", None, 1.0).scene().holes.is_none());
    assert!(masked("BLEND", None, 1.0).scene().holes.is_none());
    let error = masked("MASK", Some(0.6), 0.5).read().err();
    assert!(error.expect("nothing is there").contains("cut out"));
}

/// A masked square before another one: what is drawn, what rays meet and what is traced for comparison have the same hole.
#[test]
fn masks_are_drawn_and_compared_with_their_holes() {
    let shown = |mode: &str| {
        let mut file = masked(mode, None, 1.0);
        let mut behind = file.json["meshes"][0]["primitives"][0].clone();
        behind
            .as_object_mut()
            .expect("a primitive")
            .remove("material");
        let mesh = file.push("meshes", json!({ "primitives": [behind] }));
        file.node(
            json!({ "mesh": mesh, "translation": [-1.0, -1.0, -0.3], "scale": [3.0, 3.0, 1.0] }),
        );
        let path = folder("files").join(format!("{mode}.glb"));
        std::fs::write(&path, file.binary()).expect("a file");
        let place = "--eye 0.9,0.7,2.0 --target 0.5,0.5,0.0 --size 48x36 --radius 0.6";
        let arguments = format!("{} {place} --reference 128", path.display());
        render(mode, &arguments).expect("a picture")
    };
    let [masked, opaque] = ["MASK", "OPAQUE"].map(shown);
    for drawn in [&masked, &opaque] {
        let off = drawn.off("rmse");
        println!("{off:.4} off, of {:.4}", drawn.off("mean"));
        assert!(off < 0.06, "{off}");
    }
    let differ = rmse(&masked, &opaque);
    // The same rays each time: without the hole there is none.
    assert!(differ > 0.01, "{differ}");
}
