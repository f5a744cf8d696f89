//! The hierarchy as the GPU builds it, read back and held against what it has to be.

use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

use super::triangles::{
    BvhPass, NODE_TEXELS, NodePool, Over, ROW_TEXELS, TRIANGLE_TEXELS, TriangleBvh, cluster_levels,
    most_nodes,
};
use crate::{
    Piece, SurfelCounts,
    gpu::{binding::Kept, compute_pass},
    reference::hashing::{hash2, unit_float},
};

/// As in `wgsl/common/bvh_layout.wgsl`.
const MAX_DEPTH: u32 = 52;

struct Lab {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pass: BvhPass,
}

fn lab() -> Lab {
    pollster::block_on(async {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
        descriptor.flags |= wgpu::InstanceFlags::DISCARD_HAL_LABELS;
        let adapter = wgpu::Instance::new(descriptor)
            .request_adapter(&wgpu::RequestAdapterOptions::default())
            .await
            .expect("a graphics adapter");
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor::default())
            .await
            .expect("a device");
        Lab {
            pass: BvhPass::new(&device, None, Over::Triangles).expect("pipelines"),
            device,
            queue,
        }
    })
}

/// What rays read: words of nodes and of triangles.
#[derive(PartialEq)]
struct Words {
    nodes: Vec<[u32; 20]>,
    triangles: Vec<[u32; 12]>,
}

impl Lab {
    fn record(&self, pieces: &[Piece], bvh: &TriangleBvh) {
        let storage = |contents: &[u8]| {
            self.device
                .create_buffer_init(&wgpu::util::BufferInitDescriptor {
                    label: None,
                    contents,
                    usage: wgpu::BufferUsages::STORAGE,
                })
        };
        let counts = SurfelCounts {
            pieces: pieces.len() as u32,
            ..SurfelCounts::default()
        };
        let counters = storage(bytemuck::bytes_of(&counts));
        let mut room = pieces.to_vec();
        room.resize(bvh.capacity() as usize, Piece::default());
        let buffer = storage(bytemuck::cast_slice(&room));
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.pass
            .record(&self.device, &mut encoder, (&buffer, &counters), bvh, None);
        self.queue.submit([encoder.finish()]);
    }

    fn read(&self, bvh: &TriangleBvh) -> Words {
        let [nodes, triangles] = bvh.textures().map(|texture| self.words(texture));
        Words {
            nodes: rows(&nodes, NODE_TEXELS),
            triangles: rows(&triangles, TRIANGLE_TEXELS),
        }
    }

    fn words(&self, texture: &wgpu::Texture) -> Vec<u32> {
        let row = 16 * 4096;
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row * texture.height()),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("it maps"));
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device answers");
        let bytes = buffer.get_mapped_range(..).expect("it is mapped");
        bytemuck::pod_collect_to_vec(&bytes)
    }
}

/// Items of a few texels each, which whole rows of 4096 texels hold 4095 texels of.
fn rows<const WORDS: usize>(words: &[u32], texels_each: u32) -> Vec<[u32; WORDS]> {
    assert_eq!(WORDS, 4 * texels_each as usize);
    words
        .chunks(4 * 4096)
        .flat_map(|row| row[..4 * ROW_TEXELS as usize].chunks_exact(WORDS))
        .map(|item| item.try_into().expect("its words"))
        .collect()
}

/// Walks a hierarchy from the root, and tells how often each primitive was met, how many nodes there are, and the depth.
struct Walk<'a> {
    words: &'a Words,
    pieces: &'a [Piece],
    met: Vec<u32>,
    visited: Vec<bool>,
    depth: usize,
}

type Corners = [[f64; 3]; 2];

/// The box of a node's child.
fn corners_of(node: &[u32; 20], child: u32) -> Corners {
    let low = [node[0], node[1], node[2]].map(|w| f64::from(f32::from_bits(w)));
    let step = [0, 8, 16].map(|s| f64::from(f32::from_bits((node[3] >> s & 0xff) << 23)));
    let plane = |axis: usize, high: usize| {
        let word = node[8 + 6 * high + 2 * axis + child as usize / 4];
        low[axis] + f64::from(word >> (8 * (child % 4)) & 0xff) * step[axis]
    };
    [0, 1].map(|high| [0, 1, 2].map(|axis| plane(axis, high)))
}

impl Walk<'_> {
    /// Visits a node, whose primitives are to lie in all of the boxes.
    fn visit(&mut self, index: u32, boxes: &mut Vec<Corners>) {
        assert!(!self.visited[index as usize], "node {index} twice");
        self.visited[index as usize] = true;
        self.depth = self.depth.max(boxes.len() + 1);
        let node = self.words.nodes[index as usize];
        let (inner, leaves) = (node[3] >> 24 & 15, node[3] >> 28);
        assert!(inner + leaves <= 8);
        let present = node[6];
        for child in 0..inner + leaves {
            boxes.push(corners_of(&node, child));
            if child < inner {
                self.visit(node[4] + child, boxes);
            } else {
                let leaf = child - inner;
                let own = present >> (2 * leaf) & 3;
                assert!(own == 1 || own == 3, "{present:b}");
                let before = (present & ((1 << (2 * leaf)) - 1)).count_ones();
                for k in 0..own.count_ones() {
                    self.meet(node[5] + before + k, boxes);
                }
            }
            boxes.pop();
        }
    }

    fn meet(&mut self, triangle: u32, boxes: &[Corners]) {
        let words = self.words.triangles[triangle as usize];
        let primitive = words[3] as usize;
        self.met[primitive] += 1;
        let piece = &self.pieces[primitive];
        assert_eq!(words[..3], piece.a.map(f32::to_bits));
        let corners = [piece.a, piece.b, piece.c];
        if corners
            .iter()
            .flatten()
            .any(|x| !x.is_finite() || x.abs() > 1e18)
        {
            return;
        }
        for axis in 0..3 {
            let edge = f32::from_bits(words[4 + axis]);
            assert_eq!(edge.to_bits(), (piece.b[axis] - piece.a[axis]).to_bits());
            let x = corners.map(|corner| f64::from(corner[axis]));
            // Half of the tolerance about a triangle at least is in its boxes: the rest is rounding's.
            let margin = 5e-7 * x.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            for [low, high] in boxes {
                let inside = x
                    .iter()
                    .all(|x| low[axis] <= x - margin && x + margin <= high[axis]);
                assert!(inside, "{x:?} in {low:?} {high:?}, axis {axis}");
            }
        }
    }
}

/// Checks everything that a hierarchy has to be; its nodes and depth.
fn check(name: &str, words: &Words, pieces: &[Piece]) -> (usize, usize) {
    let mut walk = Walk {
        words,
        pieces,
        met: vec![0; pieces.len()],
        visited: vec![false; words.nodes.len()],
        depth: 0,
    };
    walk.visit(0, &mut Vec::new());
    assert!(
        walk.met.iter().all(|&met| met == 1),
        "{name}: every primitive is in one leaf"
    );
    let nodes = walk.visited.iter().filter(|&&v| v).count();
    assert!(
        nodes <= most_nodes(pieces.len() as u32) as usize,
        "{name}: {nodes}"
    );
    assert!(
        walk.depth <= MAX_DEPTH as usize,
        "{name}: depth {}",
        walk.depth
    );
    (nodes, walk.depth)
}

fn random(i: usize, salt: u32) -> f32 {
    unit_float(hash2(i as u32, salt)) as f32
}

fn piece(i: usize, corners: [[f32; 3]; 3]) -> Piece {
    let [a, b, c] = corners;
    Piece {
        a,
        b,
        c,
        triangle: i as u32,
        ..Piece::default()
    }
}

/// Small triangles anywhere in a cube.
fn scattered(count: usize, side: f32, size: f32) -> Vec<Piece> {
    (0..count)
        .map(|i| {
            let at = [0, 1, 2].map(|axis| side * (random(i, axis) - 0.5));
            let corner = |k: u32| {
                [0, 1, 2].map(|axis| at[axis as usize] + size * random(i, 10 * k + 13 + axis))
            };
            piece(i, [corner(0), corner(1), corner(2)])
        })
        .collect()
}

#[test]
fn hierarchies_are_sound() {
    let lab = lab();
    let mut cases: Vec<(String, Vec<Piece>)> = [
        0, 1, 2, 3, 4, 7, 8, 9, 63, 64, 65, 255, 256, 257, 1025, 5000,
    ]
    .map(|count| (format!("{count} scattered"), scattered(count, 10.0, 0.3)))
    .into();
    let one = [[0.5, 1.0, 2.0], [1.5, 1.0, 2.0], [0.5, 2.0, 2.0]];
    cases.push((
        "identical".into(),
        (0..3000).map(|i| piece(i, one)).collect(),
    ));
    // Each is twice as large and as far away as the one before.
    let spiral = |i: usize| {
        let s = 1.01_f32.powi(i as i32);
        piece(i, [[s, 0.0, 0.0], [s, 0.1 * s, 0.0], [s, 0.0, 0.1 * s]])
    };
    cases.push(("growing".into(), (0..2000).map(spiral).collect()));
    let points = |i: usize| piece(i, [[random(i, 0); 3]; 3]);
    cases.push(("points".into(), (0..700).map(points).collect()));
    cases.push(("flat".into(), {
        let mut flat = scattered(900, 10.0, 0.2);
        for p in &mut flat {
            (p.a[1], p.b[1], p.c[1]) = (0.0, 0.0, 0.0);
        }
        flat
    }));
    cases.push(("not finite".into(), {
        let mut odd = scattered(900, 10.0, 0.2);
        for (i, p) in odd.iter_mut().enumerate().filter(|(i, _)| i % 7 == 0) {
            p.b[i % 3] = [f32::NAN, f32::INFINITY, -f32::INFINITY, 3e38][i % 4];
        }
        odd
    }));
    let none = piece(0, [[f32::NAN; 3]; 3]);
    cases.push(("nothing finite".into(), vec![none; 300]));
    cases.push(("tiny".into(), scattered(600, 1e-12, 1e-14)));
    cases.push(("huge".into(), scattered(600, 1e17, 1e15)));
    cases.push(("far away".into(), {
        let mut far = scattered(600, 10.0, 0.2);
        for p in &mut far {
            for x in p.a.iter_mut().chain(&mut p.b).chain(&mut p.c) {
                *x += 1e5;
            }
        }
        far
    }));
    // Room for more than there is, and what was there before does not show.
    let shared = lab.pass.create(&lab.device, 6000).expect("room");
    for (name, pieces) in &cases {
        let tight = lab
            .pass
            .create(&lab.device, (pieces.len() as u32).max(1))
            .expect("room");
        for bvh in [&tight, &shared] {
            lab.record(pieces, bvh);
            let words = lab.read(bvh);
            let (nodes, depth) = check(name, &words, pieces);
            println!(
                "{name}: {nodes} nodes, {:.3} a primitive, depth {depth}",
                nodes as f64 / pieces.len() as f64
            );
        }
        // The same bits every time.
        let first = lab.read(&tight);
        lab.record(pieces, &tight);
        assert!(first == lab.read(&tight), "{name}: another tree");
    }
}

/// The shaders' `Instance`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Instance {
    low: [f32; 3],
    root: u32,
    high: [f32; 3],
    material: u32,
    x: [f32; 3],
    index: u32,
    y: [f32; 3],
    padding0: u32,
    z: [f32; 3],
    padding1: u32,
    shift: [f32; 3],
    padding2: u32,
}

crate::reflection::same_as_wgsl!(
    instances_are_the_shaders: Instance as "Instance" in ["bvh_collapse instances"]
    { low, root, high, material, x, index, y, z, shift }
);

/// Instances that have boxes of some size anywhere in a cube; one in seven is out of range.
fn instances(count: usize, side: f32, size: f32) -> Vec<Instance> {
    (0..count)
        .map(|i| {
            let low = [0, 1, 2].map(|axis| side * (random(i, axis) - 0.5));
            let mut high = low;
            for (axis, x) in (0..).zip(&mut high) {
                *x += size * random(i, 20 + axis);
            }
            let usable = i % 7 != 3 || count < 5;
            Instance {
                low: if usable { low } else { [3e38; 3] },
                high: if usable { high } else { [3e38; 3] },
                root: 100_000 + i as u32,
                index: i as u32,
                ..Instance::zeroed()
            }
        })
        .collect()
}

/// Every instance in range is a node of its own below the root, within the boxes of those above it.
fn visit_instances(
    nodes: &[[u32; 20]],
    index: u32,
    boxes: &mut Vec<Corners>,
    all: &[Instance],
    met: &mut [u32],
) -> (u32, usize) {
    let node = nodes[index as usize];
    if node[3] == u32::MAX {
        let own = node[15] as usize;
        met[own] += 1;
        assert_eq!(node[7], all[own].root);
        for [low, high] in &*boxes {
            for axis in 0..3 {
                assert!(low[axis] <= f64::from(all[own].low[axis]), "{own}");
                assert!(high[axis] >= f64::from(all[own].high[axis]), "{own}");
            }
        }
        return (index, boxes.len() + 1);
    }
    let (inner, leaves) = (node[3] >> 24 & 15, node[3] >> 28);
    assert!(inner <= 8 && leaves == 0, "{inner} {leaves}");
    let (mut last, mut depth) = (index, boxes.len() + 1);
    for child in 0..inner {
        boxes.push(corners_of(&node, child));
        let below = visit_instances(nodes, node[4] + child, boxes, all, met);
        (last, depth) = (last.max(below.0), depth.max(below.1));
        boxes.pop();
    }
    (last, depth)
}

#[test]
fn hierarchies_over_instances_are_sound() {
    let lab = lab();
    let pass = BvhPass::new(&lab.device, None, Over::Instances).expect("pipelines");
    for count in [0, 1, 2, 7, 8, 9, 15, 16, 17, 64, 257, 3000] {
        let all = instances(count, 10.0, 0.5);
        let capacity = count.max(1) as u32;
        let workspace = pass.workspace(&lab.device, capacity).expect("room");
        let most = Over::Instances.most_nodes(count as u32);
        let pool = NodePool::new(&lab.device, Over::Instances, most, 0).expect("room");
        let storage = |contents: &[u8]| {
            let descriptor = wgpu::util::BufferInitDescriptor {
                label: None,
                contents,
                usage: wgpu::BufferUsages::STORAGE,
            };
            lab.device.create_buffer_init(&descriptor)
        };
        let mut room = all.clone();
        room.resize(capacity as usize, Instance::zeroed());
        let buffer = storage(bytemuck::cast_slice(&room));
        let counts = SurfelCounts {
            pieces: count as u32,
            ..SurfelCounts::default()
        };
        let counters = storage(bytemuck::bytes_of(&counts));
        let kept = Kept::default();
        let mut groups = kept.groups(&lab.device);
        let stages = pass.bind(&mut groups, &workspace, ((&buffer, &counters), None), &pool);
        let mut encoder = lab
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut recorded = compute_pass(&mut encoder, "instances", None);
            pass.dispatch(&mut recorded, &workspace, &stages);
        }
        lab.queue.submit([encoder.finish()]);
        let nodes: Vec<[u32; 20]> = rows(&lab.words(pool.textures()[0]), NODE_TEXELS);
        let mut met = vec![0; count];
        let (last, depth) = visit_instances(&nodes, 0, &mut Vec::new(), &all, &mut met);
        for (met, instance) in met.iter().zip(&all) {
            assert_eq!(*met, u32::from(instance.low[0] < 1e18), "{count}");
        }
        assert!(last < most, "{count}: node {last} of {most}");
        assert!(depth <= MAX_DEPTH as usize, "{count}: depth {depth}");
        println!("{count} instances: depth {depth}, nodes to {last} of {most}");
    }
}

#[test]
fn room_suffices() {
    for (capacity, levels) in [
        (1, 1),
        (256, 1),
        (257, 2),
        (1024, 2),
        (1025, 3),
        (1 << 23, 9),
    ] {
        assert_eq!(cluster_levels(capacity), levels, "{capacity}");
    }
    // So high clusters get in the last block, and 8 more; of the wide nodes' levels 16 take one of the binary tree's each, the
    // others three.
    let binary = 24 + 8 * (cluster_levels(1 << 23) - 1) + 8;
    // An instance is a node more.
    assert!(16 + (binary - 16).div_ceil(3) < MAX_DEPTH);
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let lab = lab();
    let most = lab.device.limits().max_storage_buffer_binding_size / 48;
    if let Ok(capacity) = u32::try_from(most + 1) {
        let refused = lab.pass.create(&lab.device, capacity);
        assert!(matches!(refused, Err(crate::Error::Limit { .. })));
    }
}
