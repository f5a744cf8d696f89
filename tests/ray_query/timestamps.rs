//! What timestamps a recording writes.

use deep_screen_space::{BvhBuilder, Timestamps, scenes, wgpu};
use support::testing::rays::triangles;

use lab::LABS;

/// The building's begin and end are written.
#[test]
fn building_writes_its_times() {
    let gpu = LABS.gpu;
    if !gpu
        .device
        .features()
        .contains(wgpu::Features::TIMESTAMP_QUERY)
    {
        println!("this adapter has no timestamps");
        return;
    }
    let shot = LABS.shot(&scenes::cornell(), 0, 8);
    let senders = &LABS.senders(&shot, &triangles())[0];
    let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
        label: None,
        ty: wgpu::QueryType::Timestamp,
        count: 2,
    });
    let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 16,
        usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let builder = BvhBuilder::new(&gpu.device, LABS.both[0].primitives).expect("pipelines");
    let mut encoder = gpu.encoder();
    let stamps = Timestamps {
        set: &set,
        begin: 0,
        end: 1,
    };
    builder
        .record(
            &gpu.device,
            &mut encoder,
            &senders.cloud,
            &senders.bounds,
            Some(stamps),
        )
        .expect("a hierarchy");
    encoder.resolve_query_set(&set, 0..2, &resolved, 0);
    gpu.finish(encoder);
    let times: Vec<u64> = gpu.read_buffer(&resolved);
    println!("{times:?}");
    assert!(times[0] > 0 && times[1] >= times[0], "{times:?}");
}
