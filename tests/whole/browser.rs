//! The pictures that examples/web renders in a browser, on this machine's driver: `scripts/web.sh check` compares them.

use std::{fs, path::Path};

use support::testing::pipelines;
use web::{Effect, SIZE, compared};

/// A half float's value.
fn value(bits: u16) -> f32 {
    let exponent = i32::from(bits >> 10 & 31);
    let fraction = f32::from(bits & 1023);
    let value = match exponent {
        0 => fraction * 2.0_f32.powi(-24),
        31 => f32::NAN,
        _ => (1024.0 + fraction) * 2.0_f32.powi(exponent - 25),
    };
    if bits >> 15 == 0 { value } else { -value }
}

#[test]
fn pictures_for_the_browser() {
    let gpu = pipelines::gpu();
    let driver: String = gpu
        .adapter
        .name
        .split([' ', '('])
        .next()
        .unwrap_or("")
        .into();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/web/native");
    let folder = folder.join(driver.to_lowercase());
    fs::create_dir_all(&folder).expect("the folder can be made");
    for (effect, range) in [(Effect::Occlusion, 0.3..0.95), (Effect::Light, 0.05..1.0)] {
        let texels = pollster::block_on(compared(gpu, effect)).expect("a picture");
        assert_eq!(texels.len(), (SIZE[0] * SIZE[1]) as usize);
        let greens: Vec<f32> = texels.iter().map(|texel| value(texel[1])).collect();
        let mean = greens.iter().sum::<f32>() / greens.len() as f32;
        println!("{}: mean {mean}", effect.name());
        // Neither black nor white, so that what is compared is a picture.
        assert!(range.contains(&mean), "{effect:?}: mean {mean}");
        assert!(greens.iter().all(|v| *v >= 0.0 && v.is_finite()));
        // All of it or nothing: others may be reading.
        let file = folder.join(format!("{}.f16", effect.name()));
        let part = file.with_extension("part");
        fs::write(&part, bytemuck::cast_slice::<_, u8>(&texels)).expect("the file can be written");
        fs::rename(&part, &file).expect("the file can be named");
    }
}
