"""Native callbacks of Embree's tree builder, called from its own threads.

They are a page of LLVM's text form, compiled in milliseconds: Python callbacks would be a hundred
times slower than the builder. The user pointer is that of four int64: a counter of nodes, and the
addresses of the primitives, of the nodes and of the heights (furcl.bvh.embree.build_binary_tree).
The "pointers" that the builder hands around are numbers: 2 i + 1 for the leaf of the primitive at
place i, 2 i + 2 for node i.
"""

import functools
from dataclasses import dataclass

from llvmlite import binding

ROOT = 2

_TEXT = """
%child = type { i32, i32, i32, i8 }  ; reference, first and last leaf, height

declare i32 @llvm.umin.i32(i32, i32)
declare i32 @llvm.umax.i32(i32, i32)
declare i8 @llvm.umax.i8(i8, i8)

define i64 @create_node(ptr %allocator, i32 %count, ptr %user) {
  %index = atomicrmw add ptr %user, i64 1 monotonic
  %twice = shl i64 %index, 1
  %node = add i64 %twice, 2
  ret i64 %node
}

define i64 @create_leaf(ptr %allocator, ptr %primitives, i64 %count, ptr %user) {
  %place = getelementptr i64, ptr %user, i64 1
  %base = load i64, ptr %place
  %address = ptrtoint ptr %primitives to i64
  %bytes = sub i64 %address, %base
  %twice = lshr i64 %bytes, 4  ; of 32 bytes each
  %leaf = or i64 %twice, 1
  ret i64 %leaf
}

define void @set_node_bounds(i64 %node, ptr %bounds, i32 %count, ptr %user) {
  ret void
}

define internal %child @child(i64 %name, ptr %nodes, ptr %heights) {
  %half = lshr i64 %name, 1
  %is_leaf = trunc i64 %name to i1
  br i1 %is_leaf, label %leaf, label %node
leaf:
  %position = trunc i64 %half to i32
  %complement = xor i32 %position, -1
  %l0 = insertvalue %child zeroinitializer, i32 %complement, 0
  %l1 = insertvalue %child %l0, i32 %position, 1
  %l2 = insertvalue %child %l1, i32 %position, 2
  ret %child %l2
node:
  %index = sub i64 %half, 1
  %reference = trunc i64 %index to i32
  %first_at = getelementptr [4 x i32], ptr %nodes, i64 %index, i64 2
  %first = load i32, ptr %first_at
  %last_at = getelementptr [4 x i32], ptr %nodes, i64 %index, i64 3
  %last = load i32, ptr %last_at
  %height_at = getelementptr i8, ptr %heights, i64 %index
  %height = load i8, ptr %height_at
  %n0 = insertvalue %child zeroinitializer, i32 %reference, 0
  %n1 = insertvalue %child %n0, i32 %first, 1
  %n2 = insertvalue %child %n1, i32 %last, 2
  %n3 = insertvalue %child %n2, i8 %height, 3
  ret %child %n3
}

define void @set_node_children(i64 %node, ptr %children, i32 %count, ptr %user) {
  %half = lshr i64 %node, 1
  %index = sub i64 %half, 1
  %nodes_at = getelementptr i64, ptr %user, i64 2
  %nodes = load ptr, ptr %nodes_at
  %heights_at = getelementptr i64, ptr %user, i64 3
  %heights = load ptr, ptr %heights_at
  %name_a = load i64, ptr %children
  %name_b_at = getelementptr i64, ptr %children, i64 1
  %name_b = load i64, ptr %name_b_at
  %a = call %child @child(i64 %name_a, ptr %nodes, ptr %heights)
  %b = call %child @child(i64 %name_b, ptr %nodes, ptr %heights)
  %reference_a = extractvalue %child %a, 0
  %reference_b = extractvalue %child %b, 0
  %first_a = extractvalue %child %a, 1
  %first_b = extractvalue %child %b, 1
  %first = call i32 @llvm.umin.i32(i32 %first_a, i32 %first_b)
  %last_a = extractvalue %child %a, 2
  %last_b = extractvalue %child %b, 2
  %last = call i32 @llvm.umax.i32(i32 %last_a, i32 %last_b)
  %height_a = extractvalue %child %a, 3
  %height_b = extractvalue %child %b, 3
  %below = call i8 @llvm.umax.i8(i8 %height_a, i8 %height_b)
  %height = add i8 %below, 1
  %w0 = getelementptr [4 x i32], ptr %nodes, i64 %index, i64 0
  store i32 %reference_a, ptr %w0
  %w1 = getelementptr [4 x i32], ptr %nodes, i64 %index, i64 1
  store i32 %reference_b, ptr %w1
  %w2 = getelementptr [4 x i32], ptr %nodes, i64 %index, i64 2
  store i32 %first, ptr %w2
  %w3 = getelementptr [4 x i32], ptr %nodes, i64 %index, i64 3
  store i32 %last, ptr %w3
  %height_at = getelementptr i8, ptr %heights, i64 %index
  store i8 %height, ptr %height_at
  ret void
}
"""


@dataclass(frozen=True)
class Callbacks:
    """Addresses of the compiled functions, valid while this object lives."""

    create_node: int
    create_leaf: int
    set_node_bounds: int
    set_node_children: int
    engine: binding.ExecutionEngine


@functools.cache
def compiled() -> Callbacks:
    """Compile the callbacks, once a process."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine(opt=2)
    module = binding.parse_assembly(_TEXT)
    module.verify()
    engine = binding.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return Callbacks(
        create_node=engine.get_function_address("create_node"),
        create_leaf=engine.get_function_address("create_leaf"),
        set_node_bounds=engine.get_function_address("set_node_bounds"),
        set_node_children=engine.get_function_address("set_node_children"),
        engine=engine,
    )
