#include "sphere/ring_mesh.hpp"

#include <algorithm>
#include <cassert>

namespace pointmorph {

namespace {

std::size_t place_of(std::span<const Index> ring, Index v) {
    const auto found = std::ranges::find(ring, v);
    assert(found != ring.end());
    return to_size(found - ring.begin());
}

void erase(std::vector<Index>& ring, Index v) {
    ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(place_of(ring, v)));
}

/// Right behind `after`.
void insert_after(std::vector<Index>& ring, Index after, Index v) {
    ring.insert(ring.begin() + static_cast<std::ptrdiff_t>(place_of(ring, after)) + 1, v);
}

}  // namespace

RingMesh::RingMesh(Index count, std::span<const Index, 6> corners) : rings_(to_size(count)) {
    const auto [px, mx, py, my, pz, mz] =
        std::array{corners[0], corners[1], corners[2], corners[3], corners[4], corners[5]};
    at(px) = {py, pz, my, mz};
    at(mx) = {pz, py, mz, my};
    at(py) = {pz, px, mz, mx};
    at(my) = {px, pz, mx, mz};
    at(pz) = {px, py, mx, my};
    at(mz) = {py, px, my, mx};
}

bool RingMesh::joined(Index a, Index b) const {
    const auto around = ring(a);
    return std::ranges::find(around, b) != around.end();
}

Index RingMesh::left_of(Index a, Index b) const {
    const auto around = ring(a);
    return around[(place_of(around, b) + 1) % around.size()];
}

Index RingMesh::right_of(Index a, Index b) const {
    const auto around = ring(a);
    return around[(place_of(around, b) + around.size() - 1) % around.size()];
}

std::vector<Triangle> RingMesh::triangles() const {
    std::vector<Triangle> result;
    for (Index v = 0; v < to_index(rings_.size()); ++v) {
        const auto around = ring(v);
        for (std::size_t k = 0; k < around.size(); ++k) {
            const Index a = around[k], b = around[(k + 1) % around.size()];
            if (v < a && v < b) result.push_back({v, a, b});
        }
    }
    return result;
}

void RingMesh::insert(Index v, Index a, Index b, Index c) {
    at(v) = {a, b, c};
    insert_after(at(a), b, v);
    insert_after(at(b), c, v);
    insert_after(at(c), a, v);
}

bool RingMesh::can_flip(Index a, Index b) const {
    return ring(a).size() > 3 && ring(b).size() > 3 && !joined(left_of(a, b), right_of(a, b));
}

void RingMesh::flip(Index a, Index b) {
    const Index c = left_of(a, b), d = right_of(a, b);
    erase(at(a), b);
    erase(at(b), a);
    insert_after(at(c), a, d);
    insert_after(at(d), b, c);
}

bool RingMesh::can_remove(Index v, Index into) const {
    const auto around = ring(v);
    const std::size_t count = around.size(), first = place_of(around, into);
    // Their rings lose one; a surface of four vertices can't lose any.
    if (ring(around[(first + 1) % count]).size() <= 3) return false;
    if (ring(around[(first + count - 1) % count]).size() <= 3) return false;
    for (std::size_t k = 2; k + 1 < count; ++k)
        if (joined(into, around[(first + k) % count])) return false;
    return true;
}

RingMesh::Removal RingMesh::remove(Index v, Index into) {
    Removal removal{v, std::move(at(v))};
    at(v).clear();
    auto& r = removal.ring;
    std::ranges::rotate(r, r.begin() + static_cast<std::ptrdiff_t>(place_of(r, into)));
    auto& center = at(into);
    const auto place = center.begin() + static_cast<std::ptrdiff_t>(place_of(center, v));
    center.insert(center.erase(place), r.begin() + 2, r.end() - 1);
    erase(at(r[1]), v);
    erase(at(r.back()), v);
    for (std::size_t k = 2; k + 1 < r.size(); ++k) std::ranges::replace(at(r[k]), v, into);
    return removal;
}

void RingMesh::restore(const Removal& removal) {
    const auto& [v, r] = removal;
    const Index into = r.front();
    for (std::size_t k = 2; k + 1 < r.size(); ++k) {
        std::ranges::replace(at(r[k]), into, v);
        erase(at(into), r[k]);
    }
    insert_after(at(into), r[1], v);
    // In their rings v comes before the center, and behind it.
    insert_after(at(r.back()), into, v);
    auto& first = at(r[1]);
    first.insert(first.begin() + static_cast<std::ptrdiff_t>(place_of(first, into)), v);
    at(v) = r;
}

}  // namespace pointmorph
