//! Where the scene is, and where it is looked at from.

use serde_json::json;

use super::{
    Drawn,
    files::{Triangles, glb},
    render, rmse,
};

const VIEW: &str = "--vfov 50 --size 96x64";

/// A command line for a view of the corner of a room, moved by `at`.
fn view(at: [f64; 3]) -> String {
    let [eye, target] = [[3.0, 2.5, 4.0], [0.0, 0.5, 0.0]]
        .map(|p| [0, 1, 2].map(|k| (p[k] + at[k]).to_string()).join(","));
    format!("{VIEW} --eye {eye} --target {target}")
}

#[test]
fn far_from_the_origin_is_as_at_the_origin() {
    // A place whose digits f32 has not: the child's translation is lost where transforms are joined in f32, the eye's
    // fraction where it is rounded.
    let far = [4_194_311.0, 0.0, -4_194_311.0];
    let file = |name, at: [f64; 3]| {
        let nodes = json!([
            { "translation": at, "children": [1] },
            { "translation": [0.3, 0.0, 0.1], "mesh": 0 },
        ]);
        glb(name, &[Triangles::corner()], &nodes)
            .display()
            .to_string()
    };
    let (here, there) = (file("here.glb", [0.0; 3]), file("there.glb", far));
    // One of each kind: rays, their light, a shadow map, a reflective one.
    for effect in ["ao", "gi", "shadow", "sg"] {
        let what = format!("--effect {effect}");
        let at_origin = render("here", &format!("{here} {} {what}", view([0.0; 3]))).expect(effect);
        let at_far = render("there", &format!("{there} {} {what}", view(far))).expect(effect);
        // Places are rounded at the scale of what is seen: pixels at edges change sides, as do the few texels of the
        // light's map that `sg` has.
        let off = rmse(&at_origin, &at_far);
        let most = if effect == "sg" { 0.04 } else { 0.01 };
        assert!(off < most, "{effect}: {off}");
        assert!((at_origin.mean() - at_far.mean()).abs() < 1e-3, "{effect}");
    }
    let ao = format!("{there} {} --reference 16", view(far));
    let ao = render("there", &ao).expect("a picture");
    assert!(
        ao.off("rmse") < 0.1 && ao.off("bias").abs() < 0.01,
        "{}",
        ao.stats["reference"]
    );
}

/// Rasterisers move what they draw by up to half a step of a grid of their own, and the fewer pixels there are, the farther:
/// rays must start beyond that, or they meet the surface that they left (`SwiftShader`: RMSE 0.37 and 0.24).
#[test]
fn rays_of_small_pictures_leave_their_own_surface() {
    for scene in ["fence", "colonnade"] {
        let arguments = format!("{scene} --size 64x64 --reference 64");
        let drawn = render("small", &arguments).expect("a picture");
        let reference = &drawn.stats["reference"];
        assert!(drawn.off("rmse") < 0.1, "{scene}: {reference}");
        assert!(drawn.off("bias").abs() < 0.015, "{scene}: {reference}");
    }
}

#[test]
fn a_far_sky_moves_no_near_plane() {
    let nodes = json!([{ "mesh": 0, "children": [1] }, { "mesh": 1 }]);
    let render = |half, more| {
        let file = glb(
            "sky.glb",
            &[Triangles::corner(), Triangles::sky(half)],
            &nodes,
        );
        let arguments = format!("{} {} --radius 3 {more}", file.display(), view([0.0; 3]));
        render("sky", &arguments).expect("a picture")
    };
    let near = render(100.0, "--reference 16");
    // With the near plane beyond the room the picture is white, and so is the truth.
    assert!(near.off("mean") < 0.9, "{}", near.stats["reference"]);
    assert!(near.off("rmse") < 0.08, "{}", near.stats["reference"]);
    for half in [5e3, 1e6] {
        let off = rmse(&near, &render(half, ""));
        assert!(off < 0.01, "{half}: {off}");
    }
}

#[test]
fn straight_down_and_up_have_an_up_of_their_own() {
    let file = glb(
        "corner.glb",
        &[Triangles::corner()],
        &json!([{ "mesh": 0 }]),
    );
    let render = |eye: &str, more: &str| {
        let arguments = format!("{} {VIEW} --eye {eye} {more}", file.display());
        render("down", &arguments)
    };
    let down = render("0,5,0", "--target 0,0,0 --reference 16").expect("a picture");
    assert!(down.off("rmse") < 0.1, "{}", down.stats["reference"]);
    // As on a map −z is up: the wall there is above the box, and the wall at −x left of it.
    let north = render("0,5,0", "--target 0,0,0 --up 0,0,-1").expect("a picture");
    assert_eq!(rmse(&down, &north), 0.0);
    let east = render("0,5,0", "--target 0,0,0 --up 1,0,0").expect("a picture");
    assert!(rmse(&down, &east) > 0.05);
    render("0,-5,0", "--target 0,0,0").expect("a picture from below");
    let refused = render("0,5,0", "--target 0,0,0 --up 0,1,0").err();
    assert!(refused.expect("no up").contains("line of sight"));
}

#[test]
fn a_target_may_be_a_direction() {
    let at = [4_194_311.0, 0.0, -4_194_311.0];
    let nodes = json!([{ "translation": at, "mesh": 0 }]);
    let file = glb("aside.glb", &[Triangles::corner()], &nodes);
    // Along the same line of sight, next to the eye, in the scene, and as far as may be.
    for ahead in [1e-9, 1.0, 1e9] {
        let [eye, along] = [[3.0, 2.5, 4.0], [-3.0, -2.0, -4.0]];
        let point = |t: f64| [0, 1, 2].map(|k| (at[k] + eye[k] + t * along[k]).to_string());
        let [eye, target] = [0.0, ahead].map(|t| point(t).join(","));
        let arguments = format!(
            "{} {VIEW} --eye {eye} --target {target} --reference 16",
            file.display()
        );
        let drawn = render("direction", &arguments).expect("a picture");
        assert!(
            drawn.off("rmse") < 0.1,
            "{ahead}: {}",
            drawn.stats["reference"]
        );
        assert!((drawn.off("mean") - 0.65).abs() < 0.03, "{ahead}");
    }
}

#[test]
fn what_cannot_be_drawn_is_one_line() {
    let file = glb(
        "corner.glb",
        &[Triangles::corner()],
        &json!([{ "mesh": 0 }]),
    );
    let scene = format!("{} --size 8x8", file.display());
    let view = "--eye 3,2.5,4 --target 0,0.5,0";
    let refused = [
        ("--eye 1,1,1 --target 1,1,1", "distance is 0"),
        ("--eye 1e300,0,0 --target 0,0,0", "distance is inf"),
        ("--eye 1e30,0,0 --target 0,0,0", "distance is 1e30"),
        (&format!("{view} --vfov 0"), "0.0 degrees"),
        (&format!("{view} --vfov NaN"), "NaN degrees"),
        (&format!("{view} --vfov -5"), "-5.0 degrees"),
        (&format!("{view} --vfov 180"), "180.0 degrees"),
        (&format!("{view} --vfov 1e-9"), "smaller than f32"),
        (&format!("{view} --vfov 1e-300"), "smaller than f32"),
        (&format!("{view} --near 0"), "near is 0.0"),
        (&format!("{view} --near NaN"), "near is NaN"),
        (&format!("{view} --near 1e300"), "near is 1e300"),
        (&format!("{view} --camera side"), "no camera side"),
        (&format!("{view} --cameras missing.json"), "missing.json"),
        (&format!("{view} --method splat --surfels 0"), "a surfel"),
        (&format!("{view} --pieces 0"), "pieces is 0"),
        (&format!("{view} --multires"), "--multires"),
        (&format!("{view} --effect ssgi --reference"), "--reference"),
    ];
    for (arguments, why) in refused {
        let problem = render("refused", &format!("{scene} {arguments}"))
            .err()
            .expect(why);
        assert!(problem.contains(why), "{problem}");
        assert!(!problem.contains('\n') && problem.len() < 300, "{problem}");
    }
}

#[test]
fn one_picture_with_sub_images_and_without() {
    let file = glb(
        "corner.glb",
        &[Triangles::corner()],
        &json!([{ "mesh": 0 }]),
    );
    for what in [
        "vo --radius 1.5 --preset fast",
        "shadow",
        "ssgi --radius 1.5",
    ] {
        let arguments = format!("{} {} --effect {what}", file.display(), view([0.0; 3]));
        let full = render("full", &arguments).expect(what);
        let parts = render("parts", &format!("{arguments} --multires")).expect(what);
        let settings = |drawn: &Drawn| {
            ["samples", "radius"].map(|field| drawn.stats["settings"][field].clone())
        };
        assert_eq!(settings(&full), settings(&parts));
        // As far as the blend is off where pixels are left out, through the curve that a PNG has; a quarter of the radius
        // is twice as far off.
        let off = rmse(&full, &parts);
        assert!(off < 0.025, "{what}: {off}");
    }
}
