// Things by group, all in one array, by counting. Not a part of the library.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

template <class Item>
class Grouped {
public:
    Grouped() = default;
    /// `each(take)` calls `take(group, item)` for every item, in the same order whenever it is
    /// called: once to count them, then to put them. Those of a group keep that order.
    template <class Each>
    Grouped(Index groups, Each&& each) : begins_(to_size(groups) + 2, 0) {
        each([&](Index group, const Item&) { ++begins_[to_size(group) + 2]; });
        for (std::size_t k = 1; k < begins_.size(); ++k) begins_[k] += begins_[k - 1];
        items_.resize(to_size(begins_.back()));
        // Where the next one of each group goes, which in the end is where the group after begins.
        each([&](Index group, const Item& item) {
            items_[to_size(begins_[to_size(group) + 1]++)] = item;
        });
        begins_.pop_back();
    }

    Index size() const { return to_index(begins_.size()) - 1; }  ///< groups
    std::span<const Item> operator[](Index group) const {
        const auto g = to_size(group);
        return {items_.data() + begins_[g], items_.data() + begins_[g + 1]};
    }
    std::span<Item> operator[](Index group) {
        const auto g = to_size(group);
        return {items_.data() + begins_[g], items_.data() + begins_[g + 1]};
    }

private:
    std::vector<Index> begins_{0};  ///< #groups + 1, into `items_`
    std::vector<Item> items_;
};

}  // namespace pointmorph
