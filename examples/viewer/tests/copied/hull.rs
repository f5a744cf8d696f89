use deep_screen_space::*;

pub fn made(width: u32, height: u32) -> (SgHullSize, Components, SgHullSettings) {
    let size = SgHullSize {
        grid: 320,
        ..SgHullSize::new(width, height)
    };
    let components = Components::Propagation;
    let settings = SgHullSettings {
        quad: 16,
        ..SgHullSettings::default()
    };
    (size, components, settings)
}
