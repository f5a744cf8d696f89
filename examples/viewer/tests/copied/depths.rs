use deep_screen_space::*;

pub fn made() -> (VolumetricObscuranceDescriptor, ObscuranceSettings) {
    let descriptor = VolumetricObscuranceDescriptor {
        sampling: ObscuranceSampling::Areas(DiskSamples::Nine),
        volume: ObscuranceVolume::Hemisphere,
    };
    let settings = ObscuranceSettings {
        second: Some(SecondRadius { radius: 0.125, combine: Combine::Minimum }),
        radius: 0.25,
        ..ObscuranceSettings::default()
    };
    (descriptor, settings)
}
