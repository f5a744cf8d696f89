// What an effect's code (src/effect) is written against.

#if MATERIAL
#import material
#endif
#import sums

// What an effect knows of a surfel.
struct Sender {
  radius: f32,
  normal: vec3f,
#if MATERIAL
  material: Material,
#endif
#if RADIANCE
  // What it sends from each side; nothing from the back for effects that have one side alone.
  front: vec3f,
  back: vec3f,
#endif
}
