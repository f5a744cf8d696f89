//! Scenes larger than what there is room for.

use deep_screen_space::{
    Camera, CloudCapacity, Payload, Viewport,
    scenes::{self, Scene},
    wgpu::{self, util::DeviceExt},
};

use serde_json::json;

use support::{
    bounced::{BouncedRenderer, RayRoom},
    presets::bounced_preset,
    raster::{Raster, perspective},
    scene::{SceneBuffers, runs},
    shadow,
};

use super::{
    GPU,
    files::{Triangles, glb},
    render,
};

#[test]
fn a_room_whose_pieces_find_no_room_is_no_picture() {
    let room = "closed_room --size 48x32 --radius inf";
    let closed = render("room", &format!("{room} --reference 8")).expect("a picture");
    assert!(closed.off("rmse") < 0.01, "{}", closed.stats["reference"]);
    for more in ["", "--method splat"] {
        let problem = render("room", &format!("{room} {more} --pieces 100")).err();
        let problem = problem.expect("too little room");
        assert!(
            problem.contains("found no room") && !problem.contains('\n'),
            "{problem}"
        );
    }
}

#[test]
fn room_grows_to_the_pieces_that_a_scene_comes_to() {
    // With the eye on the floor large triangles are split many times, and here are many floors: more than the first guess
    // has room for.
    let floors = (0..40).fold(Triangles::default(), |floors, _| {
        floors.rectangle([-2.0, 0.0, -2.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0])
    });
    let file = glb("floors.glb", &[floors], &json!([{ "mesh": 0 }]));
    let view = "--eye 1,0,1.5 --target 0,0.00001,0 --near 1e-9 --size 16x16";
    let splat = format!("{} {view} --method splat --preset accurate", file.display());
    let drawn = render("floor", &splat).expect("a picture");
    let count = |field: &str| drawn.stats[field].as_u64().expect(field);
    assert!(
        count("pieces") > count("triangles") + 1000,
        "{}",
        drawn.stats
    );
    assert_eq!([count("piece_overflow"), count("pieces_merged")], [0, 0]);
}

/// Corners of triangles, in order, with their normals and the material.
fn triangles(scenes: &[Scene]) -> Vec<([f32; 3], [f32; 3], u32)> {
    let mut corners = Vec::new();
    for scene in scenes {
        for part in &scene.parts {
            let range = part.first_index as usize..(part.first_index + part.index_count) as usize;
            corners.extend(scene.indices[range].iter().map(|&i| {
                (
                    scene.positions[i as usize],
                    scene.normals[i as usize],
                    part.material,
                )
            }));
        }
    }
    corners
}

#[test]
fn runs_are_the_scene() {
    let scene = scenes::colonnade();
    let all = triangles(std::slice::from_ref(&scene));
    for (vertices, indices) in [(3, 3), (100, 1000), (1000, 300), (usize::MAX, usize::MAX)] {
        let runs = runs(&scene, vertices, indices);
        assert!(triangles(&runs) == all, "{vertices} vertices");
        for run in &runs {
            assert!(run.positions.len() <= vertices && run.indices.len() <= indices);
            assert!(run.parts.iter().all(|part| part.index_count > 0));
        }
    }
}

#[test]
fn runs_draw_the_same() {
    let scene = scenes::colonnade();
    let view = &scene.views[0];
    let camera = Camera::look_at(
        view.eye.into(),
        view.target.into(),
        view.up.into(),
        perspective(view.vertical_fov_degrees, 1.5, view.near),
        Viewport::full(96, 64),
    )
    .expect("a camera");
    let draw = |buffers: &SceneBuffers| {
        let raster = Raster::draw(&GPU, buffers, &camera);
        let depth = wgpu::TextureFormat::Depth32Float;
        let map = shadow::draw(&GPU, buffers, &[camera], 64, depth);
        let texels = |view: &wgpu::TextureView| GPU.read_texture::<[f32; 4]>(view.texture(), 0);
        let depths = [raster.depth.texture(), &map].map(|t| GPU.read_texture::<f32>(t, 0));
        (texels(&raster.normal), texels(&raster.albedo), depths)
    };
    let whole = SceneBuffers::new(&GPU, &scene);
    let cut = SceneBuffers::with_room(&GPU, &scene, 1000, 1500);
    assert_eq!(whole.runs.len(), 1);
    assert!(cut.runs.len() > 10);
    assert_eq!(whole.triangles(), cut.triangles());
    assert!(draw(&whole) == draw(&cut));

    let preset = bounced_preset("fast", Payload::Occlusion, scene.ao_radius).expect("a preset");
    let trace = |buffers: &SceneBuffers| {
        let capacity = CloudCapacity {
            surfels: 0,
            pieces: 100_000,
            triangles: buffers.triangles(),
        };
        let raster = Raster::draw(&GPU, buffers, &camera);
        let rays_per_pixel = preset.bounced.rays_per_pixel;
        BouncedRenderer::new(
            &GPU,
            Payload::Occlusion,
            capacity,
            [96, 64],
            RayRoom {
                rays_per_pixel,
                ..RayRoom::default()
            },
        )
        .and_then(|mut r| r.render(&GPU, &raster, buffers, &camera, &[], &preset))
        .expect("a picture")
        .visibility()
    };
    assert!(trace(&whole) == trace(&cut));
}

#[test]
fn a_texture_larger_than_a_buffer_is_read_whole() {
    let (width, height) = (70, 37);
    let texels: Vec<u32> = (0..width * height).collect();
    let texture = GPU.device.create_texture_with_data(
        &GPU.queue,
        &wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Uint,
            usage: wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        },
        wgpu::util::TextureDataOrder::LayerMajor,
        bytemuck::cast_slice(&texels),
    );
    for bytes in [0, 512, 5000, 1 << 20] {
        let read: Vec<u32> = pollster::block_on(GPU.read_texture_by(&texture, 0, bytes));
        assert!(read == texels, "{bytes} bytes");
    }
}
