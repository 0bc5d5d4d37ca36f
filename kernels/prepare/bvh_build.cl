/* Builds the blocks of the tree of a chunk of segments, or of triangles; furcl/bvh/chunk.py launches the kernels in the
   order of this file, with Embree's binary tree between the first and the second.

   Nodes of one height need nothing of each other, so the passes over nodes are launched once for each
   height: upwards to sum up, downwards to share out. Every result is a function of the tree below or of
   the lanes above, so neither the order of work-items nor the numbering of nodes changes a bit.

   Of a groom that moves (FURCL_MOTION) the tree is that of a piece of time, the one from `step` to the next
   step of the vertices. */
#include "bvh/collapse.clh"
#include "bvh/write_block.clh"

/* The middle one of three vertices, by component: in the midst of most of them, whatever one of them is. */
static inline float3 amid(uint n, __global const uint* segments, __global const StoredVertex* vertices)
{
    const float3 a = place_of_leaf(vertices, segments[n / 4]);
    const float3 b = place_of_leaf(vertices, segments[n / 2]);
    const float3 c = place_of_leaf(vertices, segments[n - 1 - n / 4]);
    return fmax(fmin(a, b), fmin(fmax(a, b), c));
}

/* Boxes for Embree: lower, unused, upper, number. They are relative to a place among them, where thin
   fibres far from the origin are not lost in rounding.

   reads    segments (first vertices), vertices
   writes   boxes, the number being the first vertex
   over     segments
   next     Embree's builder, then summarise */
__kernel void bound_segments(const uint n, __global const uint* segments,
                             __global const StoredVertex* vertices, __global float4* boxes
#if FURCL_MOTION
                             , const uint step
#endif
                             )
{
#if FURCL_MOTION
    vertices += step;
#endif
    const uint i = get_global_id(0);
    if (i >= n) return;
    const uint v = segments[i];
    const Box box = leaf_box(vertices, v, amid(n, segments, vertices));
    boxes[2 * i] = (float4)(box.lower, 0.0f);
    boxes[2 * i + 1] = (float4)(box.upper, as_float(v));
}

/* Box, cheapest cut into lanes, number of blocks and those that wait on the stack, of every node.

   reads    nodes, leaves, vertices; summaries, costs, choices of the nodes below; inverse_size: one over
            the size of the groom, which keeps surfaces within float32
   writes   summaries, costs (eight a node, [0] unused), choices
   over     by_height[begin..end): nodes of one height
   next     itself for the next height, at last place_blocks */
__kernel void summarise(
    const uint begin, const uint end, __global const uint* by_height, __global const int4* nodes,
    __global const uint* leaves, __global const StoredVertex* vertices, const float inverse_size,
    __global Summary* summaries, __global float8* costs, __global uchar* choices
#if FURCL_MOTION
    , const uint step
#endif
    )
{
#if FURCL_MOTION
    vertices += step;
#endif
    const uint i = begin + get_global_id(0);
    if (i >= end) return;
    const uint node = by_height[i];
    const float3 near = reference_of(nodes, leaves, vertices, (int)node);
    float3 lower = (float3)(INFINITY), upper = (float3)(-INFINITY);
    float cost[3][WIDTH];
    for (uint side = 0; side < 2; side++) {
        const int child = side ? nodes[node].y : nodes[node].x;
        Box box;
        float8 child_cost = (float8)(0.0f);
        if (child < 0) {
            box = leaf_box(vertices, leaves[~child], near);
        } else {
            box = (Box){summaries[child].lower.xyz, summaries[child].upper.xyz};
            box = box_seen_from(box, reference_of(nodes, leaves, vertices, child), near);
            child_cost = costs[child];
        }
        lower = fmin(lower, box.lower);
        upper = fmax(upper, box.upper);
        vstore8(child_cost, 0, cost[side]);
    }
    uchar choice[WIDTH];
    collapse(cost[0], cost[1], half_area((upper - lower) * inverse_size), cost[2], choice);
    costs[node] = vload8(0, cost[2]);
    vstore8(vload8(0, choice), node, choices);

    const BlockLanes lanes = lanes_of(nodes, choices, summaries, node, upper - lower);
    uint n_blocks = 1, stack = 0;
    for (uint lane = lanes.n_leaves; lane < lanes.n; lane++) {
        const Summary below = summaries[lanes.child[lane]];
        n_blocks += as_uint(below.lower.w);
        stack = max(stack, as_uint(below.upper.w));
    }
    stack += lanes.n > lanes.n_leaves + 1;
    summaries[node].lower = (float4)(lower, as_float(n_blocks));
    summaries[node].upper = (float4)(upper, as_float(stack));
}

/* Subtrees in the order of their surfaces. Queries for any hit begin with the last lane, and of boxes that
   a ray meets a small one is more often full of segments. */
static inline BlockLanes smallest_last(BlockLanes lanes, __global const Summary* summaries)
{
    float surface[WIDTH];
    for (uint i = lanes.n_leaves; i < lanes.n; i++) {
        const int child = lanes.child[i];
        const float area = half_area(extent_of(summaries[child]));
        uint place = i;
        for (; place > lanes.n_leaves && surface[place - 1] < area; place--) {
            surface[place] = surface[place - 1];
            lanes.child[place] = lanes.child[place - 1];
        }
        surface[place] = area;
        lanes.child[place] = child;
    }
    return lanes;
}

/* Gives every block its place: depth first, siblings side by side.

   reads    nodes, choices, leaves, summaries; places of nodes above: of a node that has a block, that
            block and where the group of its child blocks goes; FURCL_NO_BLOCK for other nodes
   writes   blocks, from first_block on: which lanes are in use, references, and in the rows, until
            fill_blocks is done with them, what the lanes hold; places of nodes below
   over     by_height[begin..end): nodes of one height, the highest first
   next     itself for the next height, at last fill_blocks */
__kernel void place_blocks(
    const uint begin, const uint end, __global const uint* by_height, __global const int4* nodes,
    __global const uint* leaves, __global const Summary* summaries, __global const uchar* choices,
    const uint first_block, __global uint2* places, __global uint* blocks)
{
    const uint i = begin + get_global_id(0);
    if (i >= end) return;
    const uint node = by_height[i];
    const uint2 place = places[node];
    if (place.x == FURCL_NO_BLOCK) return;
    __global uint* block = blocks + (size_t)FURCL_BLOCK_WORDS * (first_block + place.x);
    const BlockLanes lanes = smallest_last(
        lanes_of(nodes, choices, summaries, node, extent_of(summaries[node])), summaries);
    const uint n_subtrees = lanes.n - lanes.n_leaves;
    for (uint lane = 0; lane < lanes.n; lane++) {
        block[FURCL_BLOCK_ROWS + lane] = (uint)lanes.child[lane];
        block[FURCL_BLOCK_REFERENCES + lane] = lane < lanes.n_leaves ? leaves[~lanes.child[lane]]
                                         : first_block + place.y + lane - lanes.n_leaves;
    }
    for (uint lane = lanes.n; lane < WIDTH; lane++) block[FURCL_BLOCK_REFERENCES + lane] = 0;
    block[FURCL_BLOCK_LANES] = ((1u << lanes.n) - 1u) | ((1u << lanes.n_leaves) - 1u) << 8 |
        (FURCL_TRIANGLES ? FURCL_BLOCK_TRIANGLES : 0u);
    block[FURCL_BLOCK_LANES + 1] = 0;
    uint below = place.y + n_subtrees;
    for (uint lane = lanes.n; lane > lanes.n_leaves; lane--) {
        const int child = lanes.child[lane - 1];
        places[child] = (uint2)(place.y + lane - 1 - lanes.n_leaves, below);
        below += as_uint(summaries[child].lower.w) - 1;
    }
}

/* Writes the bounds of the lanes.

   reads    blocks as place_blocks left them, nodes, leaves, summaries, vertices, inverse_size
   writes   blocks
   over     the n blocks from first_block on
   next     rays */
__kernel void fill_blocks(
    const uint n, const uint first_block, __global uint* blocks, __global const int4* nodes, __global const uint* leaves,
    __global const Summary* summaries, __global const StoredVertex* vertices, const float inverse_size
#if FURCL_MOTION
    , const uint step
#endif
    )
{
#if FURCL_MOTION
    vertices += step;
#endif
    const uint i = get_global_id(0);
    if (i >= n) return;
    __global uint* block = blocks + (size_t)FURCL_BLOCK_WORDS * (first_block + i);
    const uint n_lanes = popcount(block[FURCL_BLOCK_LANES] & 255u), n_segments = popcount(block[FURCL_BLOCK_LANES] >> 8 & 255u);
    int child[WIDTH];
    for (uint lane = 0; lane < n_lanes; lane++) child[lane] = (int)block[FURCL_BLOCK_ROWS + lane];
    const float3 near = reference_of(nodes, leaves, vertices, child[0]);

#if FURCL_TRIANGLES
    float3 lower[WIDTH], upper[WIDTH];
    for (uint lane = 0; lane < n_lanes; lane++) {
        Box box;
        if (lane < n_segments) {
            box = leaf_box(vertices, block[FURCL_BLOCK_REFERENCES + lane], near);
        } else {
            box = (Box){summaries[child[lane]].lower.xyz, summaries[child[lane]].upper.xyz};
            box = box_seen_from(box, reference_of(nodes, leaves, vertices, child[lane]), near);
        }
        lower[lane] = box.lower;
        upper[lane] = box.upper;
    }
    for (uint word = 0; word < FURCL_BLOCK_LANES; word++) block[word] = 0;
    block[FURCL_BLOCK_LANES] |= FURCL_BLOCK_BOXES;
    write_boxes(block, n_lanes, near, lower, upper);
#else
    Capsule capsules[WIDTH];
    float3 lower[WIDTH], upper[WIDTH];
    float box_area = 0.0f, capsule_area = 0.0f;
    bool all_fit = true;
    for (uint lane = 0; lane < n_segments; lane++) {
#if FURCL_MOTION
        const Box box = leaf_box(vertices, block[FURCL_BLOCK_REFERENCES + lane], near);
        const uint leaf = (uint)~child[lane];
        capsules[lane] = fit_capsule(vertices, leaves, leaf, leaf, near, largest_of(box.upper - box.lower));
#else
        capsules[lane].a = vertex_at(vertices, block[FURCL_BLOCK_REFERENCES + lane]).xyz - near;
        capsules[lane].b = vertex_at(vertices, block[FURCL_BLOCK_REFERENCES + lane] + 1).xyz - near;
#endif
    }
    for (uint lane = n_segments; lane < n_lanes; lane++) {
        const int4 node = nodes[child[lane]];
        Box box = {summaries[child[lane]].lower.xyz, summaries[child[lane]].upper.xyz};
        box = box_seen_from(box, reference_of(nodes, leaves, vertices, child[lane]), near);
        lower[lane] = box.lower;
        upper[lane] = box.upper;
        const float3 extent = upper[lane] - lower[lane];
        if (node.w - node.z < CAPSULE_LIMIT) {
            const float size = fmax(extent.x, fmax(extent.y, extent.z));
            capsules[lane] = fit_capsule(vertices, leaves, node.z, node.w, near, size);
        } else {  /* the sphere around the box, should the block need capsules */
            all_fit = false;
            capsules[lane].a = capsules[lane].b = 0.5f * (lower[lane] + upper[lane]);
            capsules[lane].radius = 0.500001f * length(extent);
        }
        const float r = capsules[lane].radius * inverse_size;
        const float along = length((capsules[lane].b - capsules[lane].a) * inverse_size);
        capsule_area += PI * r * (along + 2.0f * r);
        box_area += half_area(extent * inverse_size);
    }
    for (uint word = 0; word < FURCL_BLOCK_LANES; word++) block[word] = 0;
    if (n_segments > 0 || (all_fit && capsule_area < box_area)) {
        /* With a radius for either end where they are segments that keep still. */
        write_capsules(block, n_lanes, FURCL_MOTION ? 0u : n_segments, near, capsules, vertices);
    } else {
        block[FURCL_BLOCK_LANES] |= FURCL_BLOCK_BOXES;
        write_boxes(block, n_lanes, near, lower, upper);
    }
#endif
}
