//! kiss3d's picture of a scene with and without the library: in a window, where O switches between no occlusion, kiss3d's own and
//! the library's, with a bounce of light; or as three files, with `--headless DIR`.

mod common;

use deep_screen_space_kiss3d::{
    RayTracedLighting, Settings,
    deep_screen_space::scenes::{self, Scene},
};
use kiss3d::prelude::*;

/// What is drawn.
#[derive(Clone, Copy, PartialEq)]
enum Shown {
    Nothing,
    Kiss3d,
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
            "--help" => return Err(USAGE.into()),
            _ => name = argument,
        }
    }
    let scene = scenes::by_name(&name).ok_or_else(|| format!("no scene {name}\n{USAGE}"))?;
    match out {
        Some(out) => pollster::block_on(headless(&scene, &out)),
        None => pollster::block_on(window(&scene)),
    }
}

/// The scene's nodes, and its camera.
fn nodes(scene: &Scene) -> (SceneNode3d, OrbitCamera3d) {
    let mut nodes = SceneNode3d::empty();
    common::add(scene, &mut nodes);
    nodes.add_light(common::sun());
    (nodes, common::camera(scene))
}

fn lighting(scene: &Scene) -> Result<RayTracedLighting, String> {
    let settings = Settings {
        occlusion_radius: Some(scene.ao_radius),
        ..Settings::default()
    };
    RayTracedLighting::new(settings).map_err(|error| error.to_string())
}

/// Switches kiss3d's own occlusion, at its default strength and the scene's radius.
fn switch(window: &mut Window, scene: &Scene, shown: Shown) {
    window.set_ssao_enabled(shown == Shown::Kiss3d);
    if shown == Shown::Kiss3d {
        window.ssao_settings_mut().radius = scene.ao_radius;
    }
}

fn set_up(window: &mut Window) {
    window.set_ambient(0.6);
    window.set_background_color(Color::new(0.4, 0.5, 0.6, 1.0));
}

async fn headless(scene: &Scene, out: &str) -> Result<(), String> {
    std::fs::create_dir_all(out).map_err(|error| format!("{out}: {error}"))?;
    let mut surface = OffscreenSurface::new(640, 400).await;
    set_up(surface.window_mut());
    let (mut nodes, mut camera) = nodes(scene);
    let mut lighting = lighting(scene)?;
    for (shown, name) in [
        (Shown::Nothing, "without"),
        (Shown::Kiss3d, "ssao"),
        (Shown::Library, "with"),
    ] {
        switch(surface.window_mut(), scene, shown);
        let image = if shown == Shown::Library {
            lighting.adopt(&mut nodes);
            surface
                .render(
                    Some(&mut nodes),
                    None,
                    Some(&mut camera),
                    None,
                    Some(&mut lighting),
                    None,
                )
                .await;
            lighting.status().map_err(|error| error.to_string())?;
            surface.snap_image()
        } else {
            surface.render_image_3d(&mut nodes, &mut camera).await
        };
        let path = format!("{out}/{name}.png");
        image
            .save(&path)
            .map_err(|error| format!("{path}: {error}"))?;
    }
    Ok(())
}

async fn window(scene: &Scene) -> Result<(), String> {
    let mut window = Window::new_with_size("deep-screen-space in kiss3d", 1024, 640).await;
    set_up(&mut window);
    let (mut nodes, mut camera) = nodes(scene);
    let mut lighting = lighting(scene)?;
    lighting.adopt(&mut nodes);
    let mut shown = Shown::Library;
    let mut told = Ok(());
    loop {
        for event in window.events().iter() {
            if let WindowEvent::Key(Key::O, Action::Press, _) = event.value {
                shown = match shown {
                    Shown::Nothing => Shown::Kiss3d,
                    Shown::Kiss3d => Shown::Library,
                    Shown::Library => Shown::Nothing,
                };
                if shown == Shown::Library {
                    lighting.adopt(&mut nodes);
                } else {
                    lighting.release(&mut nodes);
                }
                switch(&mut window, scene, shown);
            }
        }
        let renderer: Option<&mut dyn Renderer3d> = match shown {
            Shown::Library => Some(&mut lighting),
            Shown::Nothing | Shown::Kiss3d => None,
        };
        let open = window
            .render(
                Some(&mut nodes),
                None,
                Some(&mut camera),
                None,
                renderer,
                None,
            )
            .await;
        if !open {
            return Ok(());
        }
        if lighting.status() != told {
            told = lighting.status();
            if let Err(error) = &told {
                eprintln!("drawn without it: {error}");
            }
        }
    }
}
