#include "tests/report/well_formed.h"

#include <cctype>
#include <set>
#include <vector>

namespace patina::test {
namespace {

class Reader {
 public:
  explicit Reader(std::string_view page) : page_(page) {}

  std::string read() {
    if (page_.substr(0, 15) == "<!DOCTYPE html>") at_ = 15;
    bool root = false;
    while (at_ < page_.size()) {
      if (page_[at_] == '<') {
        if (page_.substr(at_, 2) == "</") {
          if (!closing()) return problem_;
        } else {
          if (open_.empty() && root) return fail("a second root");
          root = true;
          if (!opening()) return problem_;
        }
        continue;
      }
      if (open_.empty() && !std::isspace(static_cast<unsigned char>(page_[at_]))) return fail("text outside");
      if (!character()) return problem_;
    }
    if (!open_.empty()) return fail("not closed: " + open_.back());
    return root ? std::string() : fail("nothing there");
  }

 private:
  std::string fail(const std::string& what) {
    return problem_ = what + " at " + std::to_string(at_) + ": '" +
                      std::string(page_.substr(at_ > 40 ? at_ - 40 : 0, 80)) + "'";
  }
  bool failed(const std::string& what) { return fail(what), false; }

  bool character() {
    const auto c = static_cast<unsigned char>(page_[at_]);
    if (c == '<') return failed("a bare <");
    if (c < 32 && c != '\n' && c != '\t') return failed("a control character");
    if (c == '&') {
      const std::size_t end = page_.find(';', at_);
      if (end == std::string_view::npos || end - at_ > 8) return failed("a bare &");
      static const std::set<std::string_view> kKnown = {"&amp", "&lt", "&gt", "&quot", "&#39"};
      if (!kKnown.contains(page_.substr(at_, end - at_))) return failed("an unknown entity");
      at_ = end;
    }
    ++at_;
    return true;
  }

  std::string name() {
    const std::size_t from = at_;
    while (at_ < page_.size() && (std::isalnum(static_cast<unsigned char>(page_[at_])) || page_[at_] == '-' ||
                                  page_[at_] == '_' || page_[at_] == ':'))
      ++at_;
    return std::string(page_.substr(from, at_ - from));
  }

  bool opening() {
    ++at_;
    const std::string element = name();
    if (element.empty()) return failed("a tag without a name");
    std::set<std::string> attributes;
    for (;;) {
      bool blank = false;
      while (at_ < page_.size() && std::isspace(static_cast<unsigned char>(page_[at_]))) ++at_, blank = true;
      if (at_ >= page_.size()) return failed("a tag without an end");
      if (page_[at_] == '>') {
        ++at_;
        open_.push_back(element);
        return true;
      }
      if (page_.substr(at_, 2) == "/>") {
        at_ += 2;
        return true;
      }
      const std::string attribute = name();
      if (attribute.empty() || !blank) return failed("an attribute without a name");
      if (!attributes.insert(attribute).second) return failed("an attribute twice");
      if (attribute.rfind("on", 0) == 0) return failed("a script in an attribute");
      if (page_.substr(at_, 2) != "=\"") return failed("an attribute without a quoted value");
      at_ += 2;
      while (at_ < page_.size() && page_[at_] != '"')
        if (!character()) return false;
      ++at_;
    }
  }

  bool closing() {
    at_ += 2;
    const std::string element = name();
    if (at_ >= page_.size() || page_[at_] != '>') return failed("a closing tag without an end");
    ++at_;
    if (open_.empty() || open_.back() != element) return failed("closes " + element);
    open_.pop_back();
    return true;
  }

  std::string_view page_;
  std::size_t at_ = 0;
  std::vector<std::string> open_;
  std::string problem_;
};

}  // namespace

std::string whyNotWellFormed(std::string_view page) {
  return Reader(page).read();
}

}  // namespace patina::test
