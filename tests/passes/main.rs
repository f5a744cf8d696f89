//! Each pass: the GPU against its f64 mirror, what must hold of its results, and what it refuses.

mod bounced_disks;
mod bounced_z_buffer;
mod camera;
mod ggx;
mod glossy;
mod hit_resolver;
mod hull_surfels;
mod lit_hits;
mod multi_res_mask;
mod multi_res_reconstructor;
mod one_bounce;
mod reconstructor;
mod screen_space_gi;
mod sg_glossy;
mod sg_hull;
mod shaders;
mod shell_splatter;
mod soft_shadows;
mod spherical_gaussian;
mod splat_sub_images;
mod surfel_shader;
mod surfelizer;
mod temporal_accumulator;
mod timestamps;
mod trace;
mod volumetric_obscurance;
