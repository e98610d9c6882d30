// Finds the nearest road edge of points; see `edge_search.py`.

#include <cmath>
#include <limits>

#include "batch.h"
#include "map.h"

namespace drivetrain {
namespace {

constexpr int kBlock = 4;         // segments, as in `edge_index.py`
constexpr int kMaxBlocks = 8;     // of a leaf
constexpr int kLevels = 6;        // of the tree
constexpr int kCountBits = 4;     // of a leaf's number of blocks
constexpr float kRootCell = 32;   // metres
constexpr float kHeightWeight = 2;

// The tables of a bank that the search reads, and the operands in their order.
template <typename T>
struct Edges {
  Batched<const float> points;
  Batched<const bool> valid;
  Batched<const int32_t> index;
  Batched<const float> corner;
  Batched<const int32_t> shape, first_node, nodes, first_block;
  Batched<const uint16_t> blocks;
  Batched<const int32_t> first_vertex, num_edge_vertices;
  Batched<const T> vertices;
  Batched<const uint8_t> tag;
  Batched<const float> centre, quantum;
};

// The segments that a leaf of the tree lists, from start along to end; height doubled.
struct Candidates {
  static constexpr int kMost = kBlock * kMaxBlocks;

  int32_t leaf = -1, count = 0;
  float start[3][kMost], along[3][kMost], scale[kMost];
  int32_t number[kMost];  // -1 where there is no segment

  // Returns the number of the one nearest to a point, the first of several, or -1.
  int32_t nearest(const float* point) const {
    const float x = point[0], y = point[1], z = kHeightWeight * point[2];
    float squared[kMost];
    for (int i = 0; i < count; ++i) {
      const float to_x = x - start[0][i], to_y = y - start[1][i], to_z = z - start[2][i];
      const float along_offset =
          along[0][i] * to_x + along[1][i] * to_y + along[2][i] * to_z;
      const float share = std::min(std::max(along_offset * scale[i], 0.0f), 1.0f);
      const float apart_x = to_x - share * along[0][i];
      const float apart_y = to_y - share * along[1][i];
      const float apart_z = to_z - share * along[2][i];
      const float sum = apart_x * apart_x + apart_y * apart_y + apart_z * apart_z;
      squared[i] = number[i] < 0 ? std::numeric_limits<float>::infinity() : sum;
    }
    float best = std::numeric_limits<float>::infinity();
    for (int i = 0; i < count; ++i) best = std::min(best, squared[i]);
    if (best == std::numeric_limits<float>::infinity()) return -1;
    int first = 0;
    while (squared[first] != best) ++first;
    return number[first];
  }
};

// The edges of one scenario.
template <typename T>
class EdgeMap {
 public:
  EdgeMap(const Edges<T>& edges, const Place& place) {
    const int64_t scenario =
        clamped(*edges.index.at(place), edges.first_vertex.length(0));
    corner_ = edges.corner.at(place) + 2 * scenario;
    shape_ = edges.shape.at(place) + 2 * scenario;
    nodes_ = edges.nodes.at(place) + edges.first_node.at(place)[scenario];
    const int64_t first_block = edges.first_block.at(place)[scenario];
    blocks_ = edges.blocks.at(place) + edges.blocks.length(1) * first_block;
    const int64_t first_vertex = edges.first_vertex.at(place)[scenario];
    num_vertices_ = edges.num_edge_vertices.at(place)[scenario];
    vertices_ = edges.vertices.at(place) + 3 * first_vertex;
    tag_ = edges.tag.at(place) + first_vertex;
    quantum_ = edges.quantum.at(place)[scenario];
    centre_ = edges.centre.at(place) + 3 * scenario;
  }

  bool is_empty() const { return shape_[0] <= 0; }

  // Returns the leaf in which a point lies; outside of the grid, that at its rim.
  int32_t leaf(const float* point) const {
    float inside[2];
    int32_t root[2];
    for (int axis = 0; axis < 2; ++axis) {
      const float rim = std::max(shape_[axis] * kRootCell - 1e-3f, 0.0f);
      const float offset = point[axis] - corner_[axis];
      inside[axis] = offset > 0 ? std::min(offset, rim) : 0.0f;  // NaN goes to 0
      root[axis] = static_cast<int32_t>(inside[axis] / kRootCell);
    }
    int32_t node = nodes_[root[1] * shape_[0] + root[0]];
    float cells = 1 / kRootCell;  // in a metre
    for (int level = 1; level < kLevels && node < 0; ++level) {
      cells *= 2;
      const int x = static_cast<int32_t>(inside[0] * cells) % 2;
      const int y = static_cast<int32_t>(inside[1] * cells) % 2;
      node = nodes_[-node + 2 * y + x];
    }
    return node;
  }

  void list(int32_t leaf, Candidates& candidates) const {
    const uint16_t* blocks = blocks_ + (leaf >> kCountBits);
    const int num_blocks = leaf & ((1 << kCountBits) - 1);
    candidates.leaf = leaf;
    candidates.count = kBlock * num_blocks;
    for (int i = 0; i < candidates.count; ++i) {
      const int32_t number = kBlock * int32_t{blocks[i / kBlock]} + i % kBlock;
      const bool is_segment = number < num_vertices_ && tag_[number] >= kJoined;
      candidates.number[i] = is_segment ? number : -1;
      candidates.scale[i] = 0;
      for (int axis = 0; axis < 3; ++axis) {
        candidates.start[axis][i] = candidates.along[axis][i] = 0;
      }
      if (!is_segment) continue;  // there may be no vertex after it
      float squared = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const float stretch = axis == 2 ? kHeightWeight : 1;
        const T* of = vertices_ + 3 * int64_t{number} + axis;
        const float start = centre_[axis] + quantum_ * of[0];
        const float along = (centre_[axis] + quantum_ * of[3] - start) * stretch;
        candidates.start[axis][i] = start * stretch;
        candidates.along[axis][i] = along;
        squared += along * along;
      }
      candidates.scale[i] = 1 / (squared > 0 ? squared : 1.0f);
    }
  }

 private:
  const float *corner_, *centre_;
  const int32_t *shape_, *nodes_;
  const uint16_t* blocks_;
  const T* vertices_;
  const uint8_t* tag_;
  int32_t num_vertices_;
  float quantum_;
};

template <typename T>
void search(ffi::ThreadPool pool, ffi::RemainingArgs args, ffi::AnyBuffer result) {
  const BatchShape batch(result.dimensions(), 1);
  const auto operand = [&](size_t i) { return *args.get<ffi::AnyBuffer>(i); };
  const Edges<T> edges{
      {operand(0), batch},  {operand(1), batch},  {operand(2), batch},
      {operand(3), batch},  {operand(4), batch},  {operand(5), batch},
      {operand(6), batch},  {operand(7), batch},  {operand(8), batch},
      {operand(9), batch},  {operand(10), batch}, {operand(11), batch},
      {operand(12), batch}, {operand(13), batch}, {operand(14), batch},
  };
  const Batched<int32_t> found(result, batch);
  const int64_t num_points = found.length(0);
  const int64_t items_per_piece = std::max<int64_t>(1, 256 / std::max<int64_t>(1, num_points));
  for_each(pool, batch, items_per_piece, [&](const Place& place) {
    const float* points = edges.points.at(place);
    const bool* valid = edges.valid.at(place);
    int32_t* out = found.at(place);
    const EdgeMap<T> map(edges, place);
    Candidates candidates;
    for (int64_t i = 0; i < num_points; ++i) {
      if (map.is_empty() || !valid[i]) {
        out[i] = -1;
        continue;
      }
      const float* point = points + 3 * i;
      const int32_t leaf = map.leaf(point);
      if (leaf != candidates.leaf) map.list(leaf, candidates);
      out[i] = candidates.nearest(point);
    }
  });
}

ffi::Error nearest_edges(ffi::ThreadPool pool, ffi::RemainingArgs args,
                         ffi::Result<ffi::AnyBuffer> found) {
  const bool quantized =
      args.get<ffi::AnyBuffer>(11)->element_type() == ffi::DataType::S16;
  quantized ? search<int16_t>(pool, args, *found) : search<float>(pool, args, *found);
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(
    drivetrain_nearest_edges, nearest_edges,
    ffi::Ffi::Bind().Ctx<ffi::ThreadPool>().RemainingArgs().Ret<ffi::AnyBuffer>());

}  // namespace drivetrain
