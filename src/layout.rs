//! Tests only: every struct that the GPU reads has the offsets that naga finds in the WGSL.

use std::mem::offset_of;

use crate::{
    AmbientOcclusion, Channels, Effect, Material, Piece, PolygonLight, SurfelCounts,
    SurfelRadiance, SurfelSource,
    bounced_z_buffer::params::{BouncedParams, DiskParams, LightsParams},
    bvh::{
        disks::DiskBoundsParams,
        triangles::{BINARY_NODE_BYTES, BvhParams, STATE_BYTES, TASK_BYTES},
    },
    camera::CameraParams,
    depth_moments::DepthMomentsParams,
    gpu::sort::SortParams,
    hit_resolver::params::HitResolverParams,
    light::LightParams,
    multi_res_mask::params::{EdgeParams, LevelParams},
    multi_res_reconstructor::params::MultiResReconstructorParams,
    receivers::{ListedReceiversParams, ReceiversParams},
    reconstructor::params::ReconstructorParams,
    reflective_shadow_map::ReflectiveShadowMapParams,
    screen_space_gi::params::ScreenSpaceGiParams,
    sg_hull::{
        params::{HullSegment, HullVertex, SgHullCounts, SgHullParams},
        surfels::SurfelGatherParams,
        view::{PART_BYTES, REJECTED_BYTES, SPLIT_BYTES},
    },
    shaders,
    shell_splatter::params::SplatParams,
    soft_shadows::params::SoftShadowsParams,
    surfel_shader::params::{ShadowCameraParams, ShadowParams, SurfelShaderParams},
    surfelizer::params::{MeshParams, SurfelizerParams},
    temporal_accumulator::params::TemporalParams,
    volumetric_obscurance::params::ObscuranceParams,
};

/// Name and offset of each field of a Rust struct.
macro_rules! fields {
    ($type:ty: $($field:ident),*) => {
        [$((stringify!($field), offset_of!($type, $field))),*]
    };
}

/// The struct `name` of the first shader whose name begins with `shader`: offsets of its members, and its size.
fn reflect(effect: &Effect, shader: &str, name: &str) -> (Vec<(String, usize)>, usize) {
    let all = shaders(effect).expect("well-formed directives");
    let found = all
        .iter()
        .find(|s| s.name.starts_with(shader))
        .expect("a shader");
    let module = naga::front::wgsl::parse_str(&found.source).expect("valid WGSL");
    module
        .types
        .iter()
        .find_map(|(_, ty)| match (&ty.name, &ty.inner) {
            (Some(n), naga::TypeInner::Struct { members, span }) if n == name => Some((
                members
                    .iter()
                    .map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize))
                    .collect(),
                *span as usize,
            )),
            _ => None,
        })
        .unwrap_or_else(|| panic!("{shader} has no struct {name}"))
}

/// `padding` fields are compared by position only: WGSL has scalars where Rust has arrays.
fn check(effect: &Effect, shader: &str, name: &str, fields: &[(&str, usize)], size: usize) {
    let (members, span) = reflect(effect, shader, name);
    assert_eq!(span, size, "{shader}: size of {name}");
    let real = |list: Vec<(String, usize)>| -> Vec<(String, usize)> {
        list.into_iter()
            .filter(|(n, _)| !n.starts_with("padding"))
            .collect()
    };
    let fields = fields.iter().map(|(n, o)| ((*n).to_owned(), *o)).collect();
    assert_eq!(real(members), real(fields), "{shader}: {name}");
}

#[test]
fn structs_match_the_shaders() {
    let ao = AmbientOcclusion::default().effect();
    let camera = fields!(CameraParams: unproject, view_to_world, eye, far_depth, viewport, pixel, near, perspective, reference);
    for shader in [
        "surfelizer",
        "receivers",
        "reconstructor smooth",
        "reconstructor",
        "temporal_accumulator",
        "bounced_z_buffer radiance glossy",
    ] {
        check(&ao, shader, "Camera", &camera, size_of::<CameraParams>());
    }
    let params = fields!(SurfelizerParams: camera, planes, view_count, triangle_count, piece_capacity, surfel_capacity,
        radius_pixels, density, reach_radii, reach_world, origin_high, placement, origin_low, without_vertices);
    check(
        &ao,
        "surfelizer",
        "Params",
        &params,
        size_of::<SurfelizerParams>(),
    );
    let mesh = fields!(MeshParams: vertex_offset, vertex_stride, vertex_format, vertex_count, index_offset, index_format,
        base_vertex, triangles, instance_offset, instance_stride, instance_format, instances, first_triangle, material);
    check(&ao, "surfelizer", "Mesh", &mesh, size_of::<MeshParams>());
    let gbuffer = fields!(ReceiversParams: camera, normals, depth_step, depth_relative);
    check(
        &ao,
        "receivers",
        "Params",
        &gbuffer,
        size_of::<ReceiversParams>(),
    );
    // What follows the G-buffer's own.
    let after = |fields: &[(&'static str, usize)]| [gbuffer.as_slice(), fields].concat();
    check(
        &ao,
        "receivers list",
        "Params",
        &after(&fields!(ListedReceiversParams: level)),
        size_of::<ListedReceiversParams>(),
    );
    let edges = after(
        &fields!(EdgeParams: scale, slope, normal_threshold, depth_threshold, shading_threshold, sources),
    );
    check(
        &ao,
        "multi_res_mask edges",
        "Params",
        &edges,
        size_of::<EdgeParams>(),
    );
    let level = fields!(LevelParams: size, tiles, first_count, finer_by, reach, threshold, whole_from, bell);
    for stage in ["widen", "list"] {
        let shader = format!("multi_res_mask {stage}");
        check(&ao, &shader, "Params", &level, size_of::<LevelParams>());
    }
    let blend = after(
        &fields!(MultiResReconstructorParams: level, coarser, weight, plane_distance, normal_power, has_own, whole_from),
    );
    for shader in ["multi_res_reconstructor", "multi_res_reconstructor blend"] {
        check(
            &ao,
            shader,
            "Params",
            &blend,
            size_of::<MultiResReconstructorParams>(),
        );
    }
    let shadows = after(
        &fields!(SoftShadowsParams: light, level, blockers, samples, turn, extent, max_penumbra),
    );
    let bounce = after(&fields!(ScreenSpaceGiParams: project, level, samples, turn, radius));
    for list in ["", " list"] {
        let (shadows_name, bounce_name) = (
            format!("soft_shadows{list}"),
            format!("screen_space_gi{list}"),
        );
        let size = size_of::<SoftShadowsParams>();
        check(&ao, &shadows_name, "Params", &shadows, size);
        let size = size_of::<ScreenSpaceGiParams>();
        check(&ao, &bounce_name, "Params", &bounce, size);
    }
    let splat = fields!(SplatParams: size, sub_size, tiles, level, unbounded, epsilon, world_radius, seed, clusters,
        first_cluster, groups, first_group);
    for shader in ["shell_splatter build", "shell_splatter splat"] {
        check(&ao, shader, "Params", &splat, size_of::<SplatParams>());
        check(
            &ao,
            shader,
            "SurfelSource",
            &fields!(SurfelSource: normal, piece, leaf, material),
            size_of::<SurfelSource>(),
        );
        check(
            &ao,
            shader,
            "Counters",
            &fields!(SurfelCounts: pieces, surfels, rejected, stored, merged, lost_area),
            size_of::<SurfelCounts>(),
        );
    }
    let reconstructor = fields!(ReconstructorParams: camera, levels, radius, plane_distance, normal_power, viewport, sub_image);
    for shader in ["reconstructor smooth", "reconstructor"] {
        check(
            &ao,
            shader,
            "Params",
            &reconstructor,
            size_of::<ReconstructorParams>(),
        );
    }
    let shaded = |name: &str, fields: &[(&str, usize)], size: usize| {
        check(&ao, "surfel_shader shadow map samples", name, fields, size);
    };
    let params = fields!(SurfelShaderParams: light, first, splits);
    shaded("Params", &params, size_of::<SurfelShaderParams>());
    let light = fields!(LightParams: position, kind, direction, outer, color, sharpness);
    shaded("Light", &light, size_of::<LightParams>());
    let camera = fields!(ShadowCameraParams: clip, viewport, texel, depth_scale, per_w, perspective, far_depth, tilt);
    shaded("ShadowCamera", &camera, size_of::<ShadowCameraParams>());
    let shadow = fields!(ShadowParams: cameras, count, bias, depth_step);
    shaded("Shadow", &shadow, size_of::<ShadowParams>());
    let radiance = fields!(SurfelRadiance: front, back);
    shaded("SurfelRadiance", &radiance, size_of::<SurfelRadiance>());
    let lights = fields!(LightsParams: lights, count);
    let name = "bounced_z_buffer radiance lit";
    check(&ao, name, "Lights", &lights, size_of::<LightsParams>());
    let bounced = fields!(BouncedParams: size, columns, rows, frame, words, surfel_capacity, sky_radiance,
        world_radius);
    let hits = fields!(HitResolverParams: camera, columns, rows, frame, words, radius, plane_distance,
        normal_power, variance_clamp, f0, near_radius, falloff, per_hit_distance, damping, spread);
    for payload in [
        "occlusion",
        "radiance",
        "occlusion glossy",
        "radiance glossy",
    ] {
        check(
            &ao,
            &format!("bounced_z_buffer {payload}"),
            "Params",
            &bounced,
            size_of::<BouncedParams>(),
        );
        check(
            &ao,
            &format!("hit_resolver {payload} average"),
            "Params",
            &hits,
            size_of::<HitResolverParams>(),
        );
    }
    let bvh = fields!(BvhParams: capacity, level, threads);
    for stage in ["bvh_order", "bvh_cluster", "bvh_collapse"] {
        check(&ao, stage, "Params", &bvh, size_of::<BvhParams>());
        assert_eq!(reflect(&ao, stage, "State").1, STATE_BYTES as usize);
        assert_eq!(
            reflect(&ao, stage, "BinaryNode").1,
            BINARY_NODE_BYTES as usize
        );
    }
    let task = reflect(&ao, "bvh_collapse", "Task").1;
    assert_eq!(task, TASK_BYTES as usize);
    let disk_bounds = fields!(DiskBoundsParams: level, depth, capacity, level_first);
    check(
        &ao,
        "disk_bounds",
        "Params",
        &disk_bounds,
        size_of::<DiskBoundsParams>(),
    );
    let disks = fields!(DiskParams: levels, merge, seed, capacity, level_first, shell_radii);
    check(
        &ao,
        "bounced_z_buffer occlusion disks",
        "DiskParams",
        &disks,
        size_of::<DiskParams>(),
    );
    let hull = fields!(SgHullParams: camera, along, capacity, grid, tiles, f0, texel, per_pixel_capacity, error_threshold, plane_distance, gap,
        normal_cosine, quad, split_room, rays);
    let segment = fields!(HullSegment: rect, nearest, farthest, anchor, normal, spread);
    let counts = fields!(SgHullCounts: segments, fallbacks, fallback_pixels, gathered, draw, rejected, per_pixel,
        mean_irradiance, splits, points, parts, round, padding);
    let vertex = fields!(HullVertex: position, depth, red, green, blue, excess, owner, irradiance);
    for stage in [
        "sg_hull_place",
        "sg_hull_gather",
        "sg_hull_classify",
        "sg_hull albedo",
    ] {
        check(&ao, stage, "HullVertex", &vertex, size_of::<HullVertex>());
    }
    let gathered = fields!(SurfelGatherParams: offset, stored, levels, unbounded, seed, world_radius, reach, places);
    check(
        &ao,
        "sg_hull_gather surfels",
        "SurfelParams",
        &gathered,
        size_of::<SurfelGatherParams>(),
    );
    let light = fields!(PolygonLight: a, red, b, green, c, blue);
    for stage in ["sg_hull_gather polygons", "reflective_shadow_map"] {
        check(
            &ao,
            stage,
            "PolygonLight",
            &light,
            size_of::<PolygonLight>(),
        );
    }
    let map = fields!(ReflectiveShadowMapParams: camera, light);
    check(
        &ao,
        "reflective_shadow_map",
        "Params",
        &map,
        size_of::<ReflectiveShadowMapParams>(),
    );
    let first = |count: usize| &counts[..count];
    check(&ao, "sg_hull_segment", "AtomicCounters", first(3), 12);
    check(&ao, "sg_hull_place", "PlaceCounters", first(5), 32);
    check(&ao, "sg_hull_classify", "ClassifyCounters", first(9), 48);
    for (name, size) in [
        ("Split", SPLIT_BYTES),
        ("Part", PART_BYTES),
        ("RejectedQuad", REJECTED_BYTES),
        ("SplitCounters", size_of::<SgHullCounts>() as u64),
    ] {
        let (_, span) = reflect(&ao, "sg_hull_split", name);
        assert_eq!(span as u64, size, "size of {name}");
    }
    for stage in [
        "sg_hull_segment",
        "sg_hull_plan",
        "sg_hull_gather",
        "sg_hull albedo",
        "sg_hull albedo glossy",
    ] {
        check(&ao, stage, "Params", &hull, size_of::<SgHullParams>());
        check(&ao, stage, "Segment", &segment, size_of::<HullSegment>());
        check(&ao, stage, "Counters", &counts, size_of::<SgHullCounts>());
    }
    let sort = fields!(SortParams: shift, blocks);
    check(&ao, "sort", "Params", &sort, size_of::<SortParams>());
    let temporal = fields!(TemporalParams: previous, project, viewport, motion_scale, max_frames, depth_tolerance,
        normal_tolerance, clip_deviations, still, forget, previous_origin);
    for shader in ["temporal_accumulator", "temporal_accumulator show"] {
        check(
            &ao,
            shader,
            "Params",
            &temporal,
            size_of::<TemporalParams>(),
        );
    }
    let obscurance = fields!(ObscuranceParams: camera, to_pixel, from_pixel, rays, right, level, up, center, back, thickness, normals,
        depth_step, depth_relative, radii, radius_count, combine, max_pixels, box_half_width, seed, turn, moment_levels, samples);
    for variant in ["", " normals areas list"] {
        check(
            &ao,
            &format!("volumetric_obscurance{variant}"),
            "Params",
            &obscurance,
            size_of::<ObscuranceParams>(),
        );
    }
    check(
        &ao,
        "depth_moments depth",
        "Params",
        &fields!(DepthMomentsParams: camera, forward, fine, coarse),
        size_of::<DepthMomentsParams>(),
    );
    check(
        &ao,
        "surfelizer",
        "Piece",
        &fields!(Piece: a, material, b, shape, c, triangle),
        size_of::<Piece>(),
    );
    let lit = Effect {
        source: "fn max_distance(s: Sender, e: f32) -> f32 { return s.material.albedo.x; }".into(),
        channels: Channels::Three,
        materials: true,
        ..ao
    };
    check(
        &lit,
        "shell_splatter build",
        "Material",
        &fields!(Material: albedo, emission, double_sided),
        size_of::<Material>(),
    );
}
