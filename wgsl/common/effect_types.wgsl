// What an effect's code (src/effect) is written against.

#if MATERIAL
#import material
#endif
#import sums

// What an effect knows of a surfel.
struct Sender {
  radius: f32,
  normal: vec3f,
  // How many surfels near it it stands for, itself among them, on the level that it is splatted on; their sum is this many times
  // its own.
  share: f32,
#if MATERIAL
  material: Material,
#endif
#if RADIANCE
  // What it sends from each side; nothing from the back for effects that have one side alone.
  front: vec3f,
  back: vec3f,
#endif
}

#if RECEIVER
// What an effect knows of a pixel. That of the sky is 0.
struct Receiver {
  // The shading normal.
  normal: vec3f,
#if VIEW
  // Unit vector to the eye.
  to_eye: vec3f,
#endif
#if ROUGHNESS
  // Perceptual, 0 to 1.
  roughness: f32,
#endif
}
#endif
