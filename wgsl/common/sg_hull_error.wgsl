// How far light is off (src/sg_hull), in mean irradiances of the picture.

// Of an error in units of the dimmest corner, and what counts as dark, in mean irradiances.
const RELATIVE_SHARE: f32 = 0.2;
const DIMMEST: f32 = 0.005;

fn average(color: vec3f) -> f32 {
  return (color.x + color.y + color.z) / 3.0;
}

// Of a difference where the dimmest light is `least`: a share of it counts in units of that, since what is twice as bright as
// it should be is seen in the dark as well.
fn relative_error(apart: f32, least: f32, mean: f32) -> f32 {
  let scale = max(mean, 1e-30);
  return max(apart / scale, RELATIVE_SHARE * apart / (least + DIMMEST * scale));
}
