//! Bevy's picture of a scene with and without the library: in a window, where O switches between no occlusion, Bevy's own and
//! the library's (with the feature `window`); or as three files, with `--headless DIR`.

mod common;

use bevy::{
    core_pipeline::tonemapping::Tonemapping, pbr::ScreenSpaceAmbientOcclusion, prelude::*,
    render::view::Msaa,
};
use common::Headless;
use deep_screen_space_bevy::{
    DeepScreenSpacePlugin, RayTracedAmbientOcclusion, RayTracingStatus,
    deep_screen_space::scenes::{self, Scene},
};

/// What is drawn.
#[derive(Clone, Copy, PartialEq)]
enum Shown {
    Nothing,
    Bevy,
    Library,
}

const USAGE: &str = "show [SCENE] [--headless DIR]\n\
    SCENE is one of cornell, colonnade (the default), dominoes, fence, closed_room, stress";

fn main() {
    if let Err(message) = run() {
        eprintln!("show: {message}");
        std::process::exit(2);
    }
}

fn run() -> Result<(), String> {
    let (mut name, mut out) = ("colonnade".to_owned(), None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--headless" => out = Some(arguments.next().ok_or("--headless takes a folder")?),
            "--help" => {
                println!("{USAGE}");
                return Ok(());
            }
            _ => name = argument,
        }
    }
    let scene = scenes::by_name(&name).ok_or_else(|| format!("no scene {name}\n{USAGE}"))?;
    match out {
        Some(out) => headless(&scene, &out),
        None => window(&scene),
    }
}

/// Adds the scene, its lights and a camera.
fn set_up(world: &mut World, scene: &Scene) -> Entity {
    common::add(scene, world);
    world.spawn(common::sun(6000.0));
    world.insert_resource(GlobalAmbientLight {
        brightness: 1500.0,
        ..default()
    });
    world.insert_resource(ClearColor(Color::srgb(0.4, 0.5, 0.6)));
    let camera = (
        Camera3d::default(),
        Msaa::Off,
        Tonemapping::AcesFitted,
        common::view(scene),
    );
    world.spawn(camera).id()
}

/// Gives the camera what is to be shown.
fn switch(world: &mut World, camera: Entity, scene: &Scene, shown: Shown) {
    let mut camera = world.entity_mut(camera);
    camera.remove::<(RayTracedAmbientOcclusion, ScreenSpaceAmbientOcclusion)>();
    match shown {
        Shown::Nothing => {}
        Shown::Bevy => {
            camera.insert(ScreenSpaceAmbientOcclusion::default());
        }
        Shown::Library => {
            camera.insert(RayTracedAmbientOcclusion {
                radius: scene.ao_radius,
                ..default()
            });
        }
    }
}

fn headless(scene: &Scene, out: &str) -> Result<(), String> {
    std::fs::create_dir_all(out).map_err(|error| format!("{out}: {error}"))?;
    let mut bevy = Headless::new([640, 400], None, |app| {
        app.add_plugins(DeepScreenSpacePlugin);
    });
    let target = bevy.target();
    let world = bevy.app.world_mut();
    let camera = set_up(world, scene);
    world.entity_mut(camera).insert(target);
    for (shown, name) in [
        (Shown::Nothing, "without"),
        (Shown::Bevy, "ssao"),
        (Shown::Library, "with"),
    ] {
        switch(bevy.app.world_mut(), camera, scene, shown);
        let picture = bevy.picture();
        if shown == Shown::Library
            && let Some(Err(error)) = bevy.app.world().resource::<RayTracingStatus>().of(camera)
        {
            return Err(error.to_string());
        }
        let path = format!("{out}/{name}.png");
        picture
            .save(&path)
            .map_err(|error| format!("{path}: {error}"))?;
    }
    Ok(())
}

#[cfg(not(feature = "window"))]
fn window(_: &Scene) -> Result<(), String> {
    Err(format!(
        "for a window build with --features window\n{USAGE}"
    ))
}

#[cfg(feature = "window")]
fn window(scene: &Scene) -> Result<(), String> {
    let mut app = App::new();
    app.add_plugins((DefaultPlugins, DeepScreenSpacePlugin));
    let camera = set_up(app.world_mut(), scene);
    let scene = scene.clone();
    switch(app.world_mut(), camera, &scene, Shown::Library);
    let mut shown = Shown::Library;
    app.add_systems(Update, move |world: &mut World| {
        if world
            .resource::<ButtonInput<KeyCode>>()
            .just_pressed(KeyCode::KeyO)
        {
            shown = match shown {
                Shown::Nothing => Shown::Bevy,
                Shown::Bevy => Shown::Library,
                Shown::Library => Shown::Nothing,
            };
            switch(world, camera, &scene, shown);
        }
    });
    app.run();
    Ok(())
}
