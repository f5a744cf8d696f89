use deep_screen_space::*;

pub fn made() -> (Effect, SplatQuality) {
    let effect = AmbientOcclusion {
        two_sided: false,
        overlap: Overlap::Add,
        ..AmbientOcclusion::default()
    }
    .effect();
    let surfelizer = SurfelizerSettings {
        placement: Placement::Random,
        radius_pixels: 4.0,
        ..SurfelizerSettings::default()
    };
    let splat = SplatSettings {
        radius: 2.0,
        epsilon: 0.08,
        ..SplatSettings::default()
    };
    let reconstructor = ReconstructorSettings {
        normal_power: 16.0,
        ..ReconstructorSettings::default()
    };
    (effect, SplatQuality { surfelizer, splat, reconstructor })
}
