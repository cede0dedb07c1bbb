#pragma once
#include "tribode/base/error.hpp"
#include "tribode/base/options.hpp"
#include "tribode/base/text.hpp"

#include <fmt/format.h>

#include <cstddef>
#include <iterator>
#include <string>
#include <vector>

namespace tribode {

// Single fields of what has a describe(), see options.hpp, by paths such as "friction.elements[3].K". Indices count from 1;
// [*] is every entry of a list.

// One step of a path: a name, and after it an index from 1, every entry, or none of the two.
struct PathStep {
    std::string name;
    std::size_t index = 0; // 0: none
    bool every = false;
};

// Throws InputError; `where` begins the message.
std::vector<PathStep> path_steps(const std::string& path, const std::string& where);

// Calls act(path of the table around it, key, visit) for every field that the steps lead to: visit(visitor) then describes that
// field alone to a visitor. Throws InputError, beginning with `name`, where there is none.
template <class Act>
class FieldFinder {
  public:
    FieldFinder(const std::vector<PathStep>& steps, std::string name, Act& act, std::size_t at = 0,
                std::string path = "")
        : steps_(steps),
          name_(std::move(name)),
          act_(act),
          at_(at),
          path_(std::move(path)) {}

    void require_found() const {
        if (!found_)
            throw InputError(fmt::format("{}: there is no {}{}", name_, step().name, suggestion(step().name, known_)));
    }

    void number(std::string_view key, auto& value, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.number(key, value, more...); });
    }
    void required(std::string_view key, auto& value, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.required(key, value, more...); });
    }
    void optional(std::string_view key, auto& value, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.optional(key, value, more...); });
    }
    void entry(std::string_view key, auto& values, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.entry(key, values, more...); });
    }
    void integer(std::string_view key, auto& value, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.integer(key, value, more...); });
    }
    void flag(std::string_view key, auto& value, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.flag(key, value, more...); });
    }
    void choice(std::string_view key, auto& value, const std::vector<std::string>& names, const About& about = {}) {
        leaf(key, [&](auto& visitor) { visitor.choice(key, value, names, about); });
    }
    void numbers(std::string_view key, auto& values, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.numbers(key, values, more...); });
    }
    void text(std::string_view key, auto& value, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.text(key, value, more...); });
    }
    void texts(std::string_view key, auto& values, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.texts(key, values, more...); });
    }
    void constants(std::string_view key, auto& names, auto& values, auto&&... more) {
        leaf(key, [&](auto& visitor) { visitor.constants(key, names, values, more...); });
    }
    void fixed(std::string_view key, const std::string& value, const About& = {}) {
        unchanging(key, value, [&](auto& visitor, std::string& text) { visitor.text(key, text, true); });
    }
    template <class Struct>
    void list(std::string_view key, std::vector<Struct>& values, const About& = {}) {
        entries(
            key, values, [](FieldReader&) { return Struct{}; }, describe_struct);
    }
    template <class Struct>
    void list(std::string_view key, const std::vector<Struct>& values, const About& = {}) {
        entries(
            key, values, [](FieldReader&) { return Struct{}; }, describe_struct);
    }
    void entries(std::string_view key, auto& values, auto begin, auto describe, const About& about = {},
                 bool required = false) {
        if (!meant(key)) return;
        if (step().index == 0 && !step().every) {
            if (!last()) throw InputError(fmt::format("{}: {} is no table of fields", name_, step().name));
            return act_(path_, key,
                        [&](auto& visitor) { visitor.entries(key, values, begin, describe, about, required); });
        }
        if (step().index > values.size()) {
            throw InputError(fmt::format("{}: {} has {} entries", name_, step().name, values.size()));
        }
        for (std::size_t i = 0; i < values.size(); ++i) {
            if (!step().every && i + 1 != step().index) continue;
            const std::string one = fmt::format("{}[{}]", key, i + 1);
            if (last()) {
                act_(path_, one, [&](auto& visitor) { visitor.single_entry(one, values[i], begin, describe); });
            } else {
                go_on(one, [&](auto& inside) { describe(values[i], inside); });
            }
        }
    }
    void table(std::string_view key, auto& value, const About& = {}) {
        if (!meant(key)) return;
        refuse_index();
        if (last()) return act_(path_, key, [&](auto& visitor) { visitor.table(key, value); });
        if (!value) throw InputError(fmt::format("{}: there is no {}", name_, key));
        go_on(key, [&](auto& inside) { describe_struct(*value, inside); });
    }
    void group(std::string_view key, auto describe, const About& = {}) {
        if (!meant(key)) return;
        refuse_index();
        if (last()) return act_(path_, key, [&](auto& visitor) { visitor.group(key, describe); });
        go_on(key, describe);
    }
    void variant(std::string_view key, auto& value, std::string_view tag, const std::vector<std::string>& names,
                 const About& = {}) {
        if (!meant(key)) return;
        refuse_index();
        if (last()) return act_(path_, key, [&](auto& visitor) { visitor.variant(key, value, tag, names); });
        if (value.index() == 0) throw InputError(fmt::format("{}: there is no {}", name_, key));
        go_on(key, [&](auto& inside) {
            inside.unchanging(tag, names[value.index() - 1],
                              [&](auto& visitor, std::string& text) { visitor.choice(tag, text, names); });
            visit_present(value, [&](auto& kind) { describe_struct(kind, inside); });
        });
    }

    // A text that decides which other fields there are: it can be read, but not changed on its own.
    template <class Visit>
    void unchanging(std::string_view key, const std::string& value, Visit visit) {
        leaf(key, [&](auto& visitor) {
            std::string text = value;
            visit(visitor, text);
            if (text == value) return;
            throw InputError(
                fmt::format("{} = \"{}\" cannot be replaced on its own, only the whole table around it", name_, value));
        });
    }

  private:
    const PathStep& step() const { return steps_[at_]; }
    bool last() const { return at_ + 1 == steps_.size(); }
    bool meant(std::string_view key) {
        known_.emplace_back(key);
        if (key != step().name) return false;
        return found_ = true;
    }
    void refuse_index() const {
        if (step().index > 0 || step().every) throw InputError(fmt::format("{}: {} is no list", name_, step().name));
    }
    template <class Visit>
    void leaf(std::string_view key, Visit visit) {
        if (!meant(key)) return;
        refuse_index();
        if (!last()) throw InputError(fmt::format("{}: {} is no table of fields", name_, key));
        act_(path_, key, visit);
    }
    template <class Describe>
    void go_on(std::string_view key, Describe describe) {
        FieldFinder inside(steps_, name_, act_, at_ + 1, fmt::format("{}{}.", path_, key));
        describe(inside);
        inside.require_found();
    }

    const std::vector<PathStep>& steps_;
    std::string name_;
    Act& act_;
    std::size_t at_;
    std::string path_; // of the table it is in, with a dot at its end
    bool found_ = false;
    std::vector<std::string> known_;
};

// Calls act as FieldFinder does for the fields of this path. `where` begins messages.
template <class Struct, class Act>
void find_fields(Struct& value, const std::string& path, const std::string& where, Act act) {
    const auto steps = path_steps(path, where);
    FieldFinder<Act> finder(steps, fmt::format("{}: {}", where, path), act);
    describe_struct(value, finder);
    finder.require_found();
}

// Calls act(number, path, unit, allowed, about) for every number that is there, in order; path() gives its path as text.
template <class Act>
class NumberWalker {
  public:
    explicit NumberWalker(Act& act, std::string path = "") : act_(act), path_(std::move(path)) {}

    void number(std::string_view key, auto& value, std::string_view unit, Allowed allowed, const About& about = {}) {
        act_(
            value, [&] { return path_ + std::string(key); }, unit, allowed, about);
    }
    void required(std::string_view key, auto& value, std::string_view unit, Allowed allowed, const About& about = {}) {
        number(key, value, unit, allowed, about);
    }
    void optional(std::string_view key, auto& value, double none, std::string_view unit, Allowed allowed,
                  const About& about = {}) {
        if (value != none) number(key, value, unit, allowed, about);
    }
    void entry(std::string_view key, auto& values, std::string_view unit, Allowed allowed, const About& about = {}) {
        const auto value = values.find(std::string(key));
        if (value != values.end()) number(key, value->second, unit, allowed, about);
    }
    void integer(std::string_view, auto&, long, long, const About& = {}) {}
    void flag(std::string_view, auto&, const About& = {}) {}
    void choice(std::string_view, auto&, const std::vector<std::string>&, const About& = {}) {}
    void numbers(std::string_view key, auto& values, std::string_view unit, Allowed allowed, std::size_t,
                 const About& about = {}) {
        for (std::size_t i = 0; i < values.size(); ++i) {
            act_(
                values[i], [&] { return fmt::format("{}{}[{}]", path_, key, i + 1); }, unit, allowed, about);
        }
    }
    void fixed(std::string_view, const std::string&, const About& = {}) {}
    void text(std::string_view, auto&, bool, const About& = {}) {}
    void texts(std::string_view, auto&, const About& = {}) {}
    void constants(std::string_view key, auto& names, auto& values, const About& about = {}) {
        for (std::size_t i = 0; i < values.size(); ++i) {
            act_(
                values[i], [&] { return fmt::format("{}{}.{}", path_, key, names[i]); }, "", Allowed::finite, about);
        }
    }
    void list(std::string_view key, auto& values, const About& = {}) { entries(key, values, nullptr, describe_struct); }
    void entries(std::string_view key, auto& values, auto, auto describe, const About& = {}, bool = false) {
        const std::size_t length = path_.size();
        for (std::size_t i = 0; i < values.size(); ++i) {
            fmt::format_to(std::back_inserter(path_), "{}[{}].", key, i + 1);
            describe(values[i], *this);
            path_.resize(length);
        }
    }
    void single_entry(std::string_view key, auto& value, auto, auto describe) {
        inside(key, [&] { describe(value, *this); });
    }
    void table(std::string_view key, auto& value, const About& = {}) {
        if (value) inside(key, [&] { describe_struct(*value, *this); });
    }
    void group(std::string_view key, auto describe, const About& = {}) {
        inside(key, [&] { describe(*this); });
    }
    void variant(std::string_view key, auto& value, std::string_view, const std::vector<std::string>&,
                 const About& = {}) {
        visit_present(value, [&](auto& kind) { inside(key, [&] { describe_struct(kind, *this); }); });
    }

  private:
    template <class Describe>
    void inside(std::string_view key, Describe describe) {
        const std::size_t length = path_.size();
        path_.append(key).append(".");
        describe();
        path_.resize(length);
    }

    Act& act_;
    std::string path_; // of the table it is in, with a dot at its end
};

template <class Struct, class Act>
void each_number(Struct& value, Act act) {
    NumberWalker<Act> walker(act);
    describe_struct(value, walker);
}

} // namespace tribode
