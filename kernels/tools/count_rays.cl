/* What rays in plain arrays cost, for benchmarks and tests: see tools/trace_rays.cl for the arrays. */
#include "bvh/traversal.clh"

/* reads    rays
   writes   counts: of each ray the blocks that it looks at, the segments that it tests exactly, and the
            segments of its own strand that it begins inside
   over     rays */
__kernel void count_rays(
    const uint n_rays, __global const float4* origins, __global const float4* directions,
    __global const uint* from_segment, __global uint4* counts, __global const uint* blocks,
    __global const StoredVertex* vertices, __global const uint* strands)
{
    const uint i = get_global_id(0);
    if (i >= n_rays) return;
    const Groom groom = groom_of(blocks, vertices, strands);
    const float4 o = origins[i], d = directions[i];
    const Query query = {o.xyz, d.xyz, from_segment[i]};
    const Hit nothing = {d.w, 0.0f, FURCL_NO_SEGMENT};
    Traversal tv;
    Stack stack;
    traversal_begin(&groom, &tv, &stack, &query, &nothing, i, false);
    uint4 n = (uint4)(0u, 0u, query.from_segment == FURCL_NO_SEGMENT ? 0u : 1u + tv.left.y, 0u);
    do {
        n.y += popcount(tv.segments);
        if (tv.segments) traversal_tested(&groom, &tv, &stack, leaves_test(&groom, &tv), false);
        traversal_look(&groom, &tv, &stack, false);
        n.x += tv.next != FURCL_NO_BLOCK;
        traversal_push(&groom, &tv, &stack, false);
    } while (traversal_choose(&groom, &tv, &stack, false));
    counts[i] = n;
}
