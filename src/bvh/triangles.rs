//! The hierarchy over triangles, or over instances of meshes: a binary tree by clustering, collapsed to nodes of eight children
//! (`wgsl/bvh_order.wgsl`, `bvh_cluster.wgsl`, `bvh_collapse.wgsl`; `wgsl/common/bvh_layout.wgsl` says what a node is).

use bytemuck::{Pod, Zeroable};
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePass, ComputePipeline, Device, PipelineCache,
    Texture, TextureFormat, TextureUsages, TextureView,
};

use crate::{
    effect::Listing,
    error::{Error, check_limit},
    gpu::{
        Kernel, Timestamps, WORKGROUP,
        binding::{self, Group, Groups, Kept, Layout, whole},
        compute_pass, dispatch,
        listing::name_of,
        shader,
        sort::{Sort, SortBuffer},
        storage,
        texture::Plane,
        uniforms::{Parameters, Place, Uploaded},
    },
};

const LABEL: &str = "deep-screen-space bvh";

/// Bytes of an indirect dispatch.
const DISPATCH_BYTES: u64 = 12;

/// As in `wgsl/common/bvh_layout.wgsl`: texels of a row, of a node and of a triangle.
pub(super) const ROW_TEXELS: u32 = 4095;
pub(super) const NODE_TEXELS: u32 = 5;
pub(super) const TRIANGLE_TEXELS: u32 = 3;
const ALPHA_TESTED_TEXELS: u32 = 5;

/// As in `wgsl/common/bvh_build.wgsl`: primitives that a workgroup clusters at a time, and a quarter of it, which it leaves.
const BLOCK: u32 = 256;
const BLOCK_LEFT: u32 = 64;

/// Bytes of the shaders' `BinaryNode`, `State` and `Task`.
const BINARY_NODE_BYTES: u64 = 48;
const STATE_BYTES: u64 = 560;
const TASK_BYTES: u64 = 16;

crate::reflection::bytes_of_wgsl!(
    nodes_are_the_shaders: BINARY_NODE_BYTES, as "BinaryNode" in [
        "bvh_order", "bvh_cluster", "bvh_collapse",
    ]
);
crate::reflection::bytes_of_wgsl!(
    state_is_the_shaders: STATE_BYTES, as "State" in ["bvh_order", "bvh_cluster", "bvh_collapse"]
);
crate::reflection::bytes_of_wgsl!(
    tasks_are_the_shaders: TASK_BYTES, as "Task" in ["bvh_collapse"]
);

/// Levels of nodes that have a dispatch of their own; the last dispatch makes all that are left.
const LEVELS: u32 = 16;

/// A hierarchy over up to so many triangles.
#[derive(Debug)]
pub(crate) struct TriangleBvh {
    pool: NodePool,
    workspace: Workspace,
    kept: Kept,
}

/// What rays read: textures of nodes and of triangles, of one hierarchy or of several.
#[derive(Debug)]
pub(crate) struct NodePool {
    node_texture: Texture,
    triangle_texture: Texture,
    pub nodes: TextureView,
    pub triangles: TextureView,
}

/// What a hierarchy over up to so many primitives is made by. One serves any number of them, one after the other.
#[derive(Debug)]
pub(crate) struct Workspace {
    capacity: u32,
    /// Of what is made: first of all the number of primitives, then where it goes.
    pub state: Buffer,
    dispatches: Buffer,
    order: SortBuffer,
    clusters: [Buffer; 2],
    binary: Buffer,
    tasks: Buffer,
    /// For each level of clusters, and of nodes.
    parameters: Uploaded,
    levels: Vec<Place>,
}

/// What a hierarchy is built over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Over {
    /// A cloud's pieces, or a mesh's triangles.
    Triangles,
    /// The same, of which some have holes.
    AlphaTested,
    /// Instances of meshes.
    Instances,
}

impl Over {
    pub fn flags(self) -> &'static [&'static str] {
        match self {
            Self::Triangles => &[],
            Self::AlphaTested => &["ALPHA_TESTED"],
            Self::Instances => &["INSTANCES"],
        }
    }

    /// The most nodes over `count`: see `wgsl/bvh_collapse.wgsl`.
    pub fn most_nodes(self, count: u32) -> u32 {
        match self {
            Self::Triangles | Self::AlphaTested => most_nodes(count),
            Self::Instances => {
                1 + (4 * count).saturating_sub(8) / 7 + if count > 1 { count } else { 0 }
            }
        }
    }

    /// What a triangle takes, and what those are, for errors.
    fn triangle_texels(self) -> (u32, &'static str) {
        match self {
            Self::AlphaTested => (ALPHA_TESTED_TEXELS, "rows of 819 triangles each"),
            _ => (TRIANGLE_TEXELS, "rows of 1365 triangles each"),
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct BvhParams {
    pub(crate) capacity: u32,
    pub(crate) level: u32,
    pub(crate) threads: u32,
    pub(crate) padding: u32,
}

crate::reflection::same_as_wgsl!(
    params_are_the_shaders: BvhParams as "Params" in ["bvh_order", "bvh_cluster", "bvh_collapse"]
    { capacity, level, threads }
);

/// The most nodes over `count` triangles: see `wgsl/bvh_collapse.wgsl`.
pub(super) fn most_nodes(count: u32) -> u32 {
    1 + (8 * count).saturating_sub(24) / 21
}

/// Levels of clustering, each of which leaves a quarter, until a block is left.
pub(super) fn cluster_levels(capacity: u32) -> u32 {
    let mut blocks = capacity.div_ceil(BLOCK).max(1);
    let mut levels = 1;
    while blocks > 1 {
        blocks = blocks.div_ceil(4);
        levels += 1;
    }
    levels
}

/// Workgroups that make a level of nodes. They take them in turn, of which only the GPU knows the number: few where there are
/// few nodes at most, or as good as always.
fn collapse_groups(capacity: u32, level: u32) -> u32 {
    let most = capacity.div_ceil(1024).clamp(1, 256);
    let nodes = 1_u32 << (3 * level).min(30);
    match level {
        0..10 => most.min(nodes.div_ceil(WORKGROUP)),
        _ => most.div_ceil(8),
    }
}

impl TriangleBvh {
    pub fn capacity(&self) -> u32 {
        self.workspace.capacity
    }

    pub fn nodes(&self) -> &TextureView {
        &self.pool.nodes
    }

    pub fn triangles(&self) -> &TextureView {
        &self.pool.triangles
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.pool.bytes() + self.workspace.bytes()
    }

    #[cfg(test)]
    pub(super) fn textures(&self) -> [&Texture; 2] {
        self.pool.textures()
    }
}

impl NodePool {
    /// Room for so many nodes and triangles.
    pub fn new(device: &Device, over: Over, nodes: u32, triangles: u32) -> Result<Self, Error> {
        let of_nodes = ("deep-screen-space bvh nodes", "rows of 819 nodes each");
        let node_texture = texels(device, of_nodes, nodes, NODE_TEXELS)?;
        let (texels_each, rows) = over.triangle_texels();
        let of_triangles = ("deep-screen-space bvh triangles", rows);
        let triangle_texture = texels(device, of_triangles, triangles, texels_each)?;
        let view = |texture: &Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        Ok(Self {
            nodes: view(&node_texture),
            triangles: view(&triangle_texture),
            node_texture,
            triangle_texture,
        })
    }

    pub(super) fn textures(&self) -> [&Texture; 2] {
        [&self.node_texture, &self.triangle_texture]
    }

    /// GPU memory that it owns, bytes.
    pub fn bytes(&self) -> u64 {
        self.textures()
            .iter()
            .map(|t| 16 * u64::from(t.width()) * u64::from(t.height()))
            .sum()
    }
}

impl Workspace {
    /// Room for building over `capacity` primitives.
    pub fn new(device: &Device, sort: &Sort, over: Over, capacity: u32) -> Result<Self, Error> {
        let none = BufferUsages::empty();
        // First: of all that is needed it is what a device's limits refuse before anything else.
        let binary = storage(
            device,
            "deep-screen-space bvh binary nodes",
            BINARY_NODE_BYTES * u64::from(capacity),
            none,
        )?;
        let state = storage(device, "deep-screen-space bvh state", STATE_BYTES, none)?;
        let blocks = u64::from(capacity.div_ceil(BLOCK));
        let clusters = |blocks: u64| {
            storage(
                device,
                "deep-screen-space bvh clusters",
                8 * u64::from(BLOCK_LEFT) * blocks,
                none,
            )
        };
        let mut parameters = Parameters::new(device);
        let levels = 0..=LEVELS.max(cluster_levels(capacity));
        let levels = levels
            .map(|level| {
                parameters.add(&BvhParams {
                    capacity,
                    level,
                    threads: collapse_groups(capacity, level) * WORKGROUP,
                    padding: 0,
                })
            })
            .collect();
        Ok(Self {
            parameters: parameters.fixed(device, LABEL),
            levels,
            capacity,
            dispatches: storage(
                device,
                "deep-screen-space bvh dispatches",
                DISPATCH_BYTES * u64::from(1 + cluster_levels(capacity)),
                BufferUsages::INDIRECT,
            )?,
            order: sort.buffer(
                device,
                "deep-screen-space order of primitives",
                capacity,
                &state,
            )?,
            clusters: [clusters(blocks)?, clusters(blocks.div_ceil(4))?],
            binary,
            tasks: storage(
                device,
                "deep-screen-space bvh tasks",
                TASK_BYTES * u64::from(over.most_nodes(capacity)),
                none,
            )?,
            state,
        })
    }

    /// GPU memory that it owns, bytes.
    pub fn bytes(&self) -> u64 {
        let buffers = [
            &self.state,
            &self.dispatches,
            &self.clusters[0],
            &self.clusters[1],
            &self.binary,
            &self.tasks,
        ];
        buffers.iter().map(|b| b.size()).sum::<u64>() + self.order.bytes()
    }
}

/// A texture of so many items of a few texels each, in whole rows; `why` is what they are, for where they are too many.
fn texels(
    device: &Device,
    (label, why): (&str, &'static str),
    items: u32,
    texels_each: u32,
) -> Result<Texture, Error> {
    let rows = items.div_ceil(ROW_TEXELS / texels_each).max(1);
    check_limit(
        "max_texture_dimension_2d",
        u64::from(device.limits().max_texture_dimension_2d),
        u64::from(rows.max(ROW_TEXELS)),
        why,
    )?;
    let usage =
        TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC;
    let size = [ROW_TEXELS, rows];
    Ok(Plane::new(label, TextureFormat::Rgba32Uint, size, usage).create(device))
}

/// The pipelines.
#[derive(Debug)]
pub(crate) struct BvhPass {
    over: Over,
    plan_layout: Layout,
    order_layout: Layout,
    cluster_layout: Layout,
    collapse_layout: Layout,
    plan: ComputePipeline,
    measure: ComputePipeline,
    make_keys: ComputePipeline,
    sort: Sort,
    cluster: ComputePipeline,
    collapse: ComputePipeline,
    collapse_rest: ComputePipeline,
}

/// The bind groups of a building.
#[derive(Debug)]
pub(crate) struct Stages {
    plan: Group,
    keys: Group,
    clusters: Vec<Group>,
    nodes: Vec<Group>,
}

/// The module of a stage.
fn source(stage: &str, over: Over) -> Result<String, Error> {
    let text = match stage {
        "bvh_order" => include_str!("../../wgsl/bvh_order.wgsl"),
        "bvh_cluster" => include_str!("../../wgsl/bvh_cluster.wgsl"),
        _ => include_str!("../../wgsl/bvh_collapse.wgsl"),
    };
    shader::assemble(stage, text, over.flags(), &[])
}

impl BvhPass {
    pub fn new(device: &Device, cache: Option<&PipelineCache>, over: Over) -> Result<Self, Error> {
        let kernel = |module, entry, layout: &Layout| {
            Kernel {
                label: &format!("{LABEL}: {entry}"),
                module,
                entry,
                layouts: &[&layout.raw],
                constants: &[],
                cache,
            }
            .create(device)
        };
        let module = |stage| Ok::<_, Error>(shader::create(device, LABEL, source(stage, over)?));
        let order = module("bvh_order")?;
        let cluster = module("bvh_cluster")?;
        let collapse = module("bvh_collapse")?;
        // A dispatch cannot bind the buffer that sizes it, which the plan alone writes.
        let plan_layout = order.layout(device, &["plan"]);
        let order_layout = order.layout(device, &["measure", "make_keys"]);
        let cluster_layout = cluster.layout(device, &["cluster"]);
        let collapse_layout = collapse.layout(device, &["collapse", "collapse_rest"]);
        Ok(Self {
            over,
            plan: kernel(&order, "plan", &plan_layout),
            measure: kernel(&order, "measure", &order_layout),
            make_keys: kernel(&order, "make_keys", &order_layout),
            sort: Sort::new(device, cache)?,
            cluster: kernel(&cluster, "cluster", &cluster_layout),
            collapse: kernel(&collapse, "collapse", &collapse_layout),
            collapse_rest: kernel(&collapse, "collapse_rest", &collapse_layout),
            plan_layout,
            order_layout,
            cluster_layout,
            collapse_layout,
        })
    }

    /// What building over `capacity` primitives takes.
    pub fn workspace(&self, device: &Device, capacity: u32) -> Result<Workspace, Error> {
        Workspace::new(device, &self.sort, self.over, capacity)
    }

    /// Room for `capacity` triangles.
    pub fn create(&self, device: &Device, capacity: u32) -> Result<TriangleBvh, Error> {
        let workspace = self.workspace(device, capacity)?;
        Ok(TriangleBvh {
            pool: NodePool::new(device, self.over, self.over.most_nodes(capacity), capacity)?,
            workspace,
            kept: Kept::default(),
        })
    }

    /// Records into a pass of its own. `pieces` are the triangles, with the counters of what there are.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        primitives: (&Buffer, &Buffer),
        bvh: &TriangleBvh,
        timestamps: Option<Timestamps<'_>>,
    ) {
        let stages = self.bind_to(device, primitives, None, bvh);
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        self.dispatch(&mut pass, &bvh.workspace, &stages);
    }

    /// Binds what the building of a hierarchy reads and writes.
    pub fn bind_to(
        &self,
        device: &Device,
        primitives: (&Buffer, &Buffer),
        cutouts: Option<&Buffer>,
        bvh: &TriangleBvh,
    ) -> Stages {
        let mut groups = bvh.kept.groups(device);
        self.bind(
            &mut groups,
            &bvh.workspace,
            (primitives, cutouts),
            &bvh.pool,
        )
    }

    /// Records the building of a hierarchy into a pass that is begun.
    pub fn dispatch_to(&self, pass: &mut ComputePass<'_>, bvh: &TriangleBvh, stages: &Stages) {
        self.dispatch(pass, &bvh.workspace, stages);
    }

    /// Binds what a building reads and writes. `counters` tell how many `primitives` there are; `cutouts` are the holes that they
    /// have, for [`Over::AlphaTested`].
    pub fn bind(
        &self,
        groups: &mut Groups<'_>,
        workspace: &Workspace,
        ((primitives, counters), cutouts): ((&Buffer, &Buffer), Option<&Buffer>),
        pool: &NodePool,
    ) -> Stages {
        let Workspace { state, order, .. } = workspace;
        let params = |level: u32| {
            let place = workspace.levels[level as usize];
            ("params", workspace.parameters.at(place))
        };
        let resources = [
            params(0),
            ("counters", whole(counters)),
            ("state", whole(state)),
            ("dispatches", whole(&workspace.dispatches)),
        ];
        let plan = groups.next(&self.plan_layout, &resources);
        let resources = [
            ("primitives", whole(primitives)),
            ("state", whole(state)),
            ("items", whole(&order.items)),
        ];
        let keys = groups.next(&self.order_layout, &resources);
        let clusters = (0..cluster_levels(workspace.capacity))
            .map(|level| {
                let [even, odd] = &workspace.clusters;
                let (left, below) = if level % 2 == 0 {
                    (even, odd)
                } else {
                    (odd, even)
                };
                let resources = [
                    params(level),
                    ("state", whole(state)),
                    ("primitives", whole(primitives)),
                    ("items", whole(&order.items)),
                    ("clusters_below", whole(below)),
                    ("clusters_left", whole(left)),
                    ("binary", whole(&workspace.binary)),
                ];
                groups.next(&self.cluster_layout, &resources)
            })
            .collect();
        let nodes = (0..=LEVELS)
            .map(|level| {
                let mut resources = vec![
                    params(level),
                    ("state", whole(state)),
                    ("primitives", whole(primitives)),
                    ("binary", whole(&workspace.binary)),
                    ("tasks", whole(&workspace.tasks)),
                    ("nodes", binding::view(&pool.nodes)),
                ];
                if self.over != Over::Instances {
                    resources.push(("triangles", binding::view(&pool.triangles)));
                }
                resources.extend(cutouts.map(|cutouts| ("cutouts", whole(cutouts))));
                groups.next(&self.collapse_layout, &resources)
            })
            .collect();
        Stages {
            plan,
            keys,
            clusters,
            nodes,
        }
    }

    /// Records the building.
    pub fn dispatch(&self, pass: &mut ComputePass<'_>, workspace: &Workspace, stages: &Stages) {
        dispatch(pass, &self.plan, &stages.plan, 1);
        pass.set_bind_group(0, &stages.keys.raw, &stages.keys.offsets);
        for pipeline in [&self.measure, &self.make_keys] {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups_indirect(&workspace.dispatches, 0);
        }
        self.sort.record(pass, &workspace.order);
        pass.set_pipeline(&self.cluster);
        for (level, group) in (1..).zip(&stages.clusters) {
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups_indirect(&workspace.dispatches, DISPATCH_BYTES * level);
        }
        for (level, group) in (0..).zip(&stages.nodes) {
            if level < LEVELS {
                let groups = collapse_groups(workspace.capacity, level);
                dispatch(pass, &self.collapse, group, groups);
            } else {
                dispatch(pass, &self.collapse_rest, group, 1);
            }
        }
    }
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for stage in ["bvh_order", "bvh_cluster", "bvh_collapse"] {
        all.add(stage, source(stage, Over::Triangles)?);
        let instances = name_of(stage, &[(true, "instances")]);
        all.add(&instances, source(stage, Over::Instances)?);
    }
    let collapse = "bvh_collapse";
    all.add(
        &name_of(collapse, &[(true, "alpha tested")]),
        source(collapse, Over::AlphaTested)?,
    );
    Ok(())
}
