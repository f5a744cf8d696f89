//! CPU references (feature `reference`): a mirror in f64 of each pass, which reads line by line like its shader, and the
//! ray-traced truth.

pub mod bounced_disks;
pub mod bounced_z_buffer;
pub mod depth_moments;
pub mod directions;
pub mod effects;
pub mod gbuffer;
pub mod ggx;
pub mod hashing;
pub mod hit_reconstructor;
pub mod light;
pub mod multi_res_mask;
pub mod multi_res_reconstructor;
pub mod packing;
pub mod receivers;
pub mod reconstructor;
pub mod sample_tables;
pub mod screen_space_gi;
pub mod sg_hull;
pub mod shell_splatter;
pub mod soft_shadows;
pub mod surfel_shader;
pub mod surfelizer;
pub mod temporal_accumulator;
pub mod trace;
pub mod volumetric_obscurance;
