//! What it costs where nothing has holes.

use deep_screen_space::{AmbientOcclusion, Primitives, shaders};

use support::testing::{pipelines, rays::AMPLE};

/// Bindings of the shaders of ambient occlusion alone, by number, and sizes of what it has: as they were before triangles could
/// have holes.
#[test]
fn nothing_of_it_is_there_where_unused() {
    let all = shaders(&AmbientOcclusion::default().effect()).expect("shaders");
    let bindings = |name: &str| {
        let shader = all.iter().find(|s| s.name == name).expect(name);
        let module = naga::front::wgsl::parse_str(&shader.source).expect("a module");
        let mut numbers: Vec<u32> = module
            .global_variables
            .iter()
            .filter_map(|(_, v)| v.binding.map(|b| b.binding))
            .collect();
        numbers.sort_unstable();
        numbers
    };
    assert_eq!(
        bindings("bounced_z_buffer occlusion"),
        [0, 1, 2, 3, 4, 5, 9, 11]
    );
    assert_eq!(
        bindings("bounced_z_buffer occlusion alpha tested"),
        [0, 1, 2, 3, 4, 5, 9, 11, 35]
    );
    assert_eq!(bindings("bvh_collapse"), [0, 1, 2, 3, 4, 5, 6]);
    assert_eq!(
        bindings("instanced_bvh"),
        (0..12).collect::<Vec<_>>(),
        "of meshes"
    );
    for shader in &all {
        let is_of_holes = ["alpha_test", "surfel_holes"].contains(&&*shader.name);
        let own = shader.name.contains("alpha tested") || is_of_holes;
        let is_code = |line: &&str| !line.trim_start().starts_with("//");
        let code: Vec<&str> = shader.source.lines().filter(is_code).collect();
        let code = code.join("\n");
        for word in ["alpha_maps", "cutout", "HAS_HOLES"] {
            assert!(own || !code.contains(word), "{} has {word}", shader.name);
        }
    }
    // 151 bytes a piece, of which the textures are 16 * (3 + 5 * 8 / 21); with holes 64 more.
    let gpu = pipelines::gpu();
    let cloud = pipelines::surfelizer()
        .create_cloud(&gpu.device, AMPLE)
        .expect("a cloud");
    let bytes = |primitives| {
        let builder = pipelines::bvh_builder(primitives);
        let bvh = builder.create(&gpu.device, &cloud).expect("room");
        bvh.memory_bytes() as f64 / f64::from(AMPLE.pieces)
    };
    let (plain, holed) = (bytes(Primitives::Triangles), bytes(Primitives::AlphaTested));
    println!("{plain:.1} bytes a triangle, {holed:.1} with holes");
    assert!((plain - 151.0).abs() < 2.0, "{plain}");
    assert!((holed - plain - 64.0).abs() < 2.0, "{holed}");
}
