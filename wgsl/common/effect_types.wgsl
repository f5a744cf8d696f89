// What an effect's code (src/effect.rs) is written against.

#if MATERIAL
#import material
#endif

// What an effect knows of a surfel.
struct Sender {
  radius: f32,
  normal: vec3f,
#if MATERIAL
  material: Material,
#endif
}

#if COLOR
alias Sum = vec3f;
#else
alias Sum = f32;
#endif
