#include "SurefootLinkFile.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>

namespace surefoot {

namespace {

// Files of later versions have fields that mean something else.
constexpr int known_version = 1;
// Deeper files are no links, and would overflow the stack.
constexpr int most_depth = 32;

// A name without case and underscores.
std::string plain(const std::string& name) {
    std::string found;
    for (const char letter : name) {
        if (letter != '_') {
            found.push_back(char(std::tolower(static_cast<unsigned char>(letter))));
        }
    }
    return found;
}

// A value of JSON; words are numbers or of no interest.
struct Json {
    enum class Kind { Null, Number, Text, List, Object };

    Kind kind = Kind::Null;
    double number = 0.0;
    std::string text;
    std::vector<Json> items;
    std::map<std::string, Json> fields;

    const Json& field(const char* name) const {
        static const Json missing;
        const auto found = fields.find(plain(name));
        return found == fields.end() ? missing : found->second;
    }
};

class Parser {
public:
    explicit Parser(const std::string& text) : text_(text) {
        // Editors on Windows put a byte order mark in front.
        at_ = text.compare(0, 3, "\xEF\xBB\xBF") == 0 ? 3 : 0;
    }

    Result<Json> parse() {
        Json value = parse_value();
        skip_space();
        if (at_ < text_.size()) {
            expect("the end of the file");
        }
        if (error_.is_set()) {
            return error_;
        }
        return value;
    }

private:
    Json parse_value() {
        skip_space();
        switch (peek()) {
        case '{': return parse_nested(Json::Kind::Object, '}');
        case '[': return parse_nested(Json::Kind::List, ']');
        case '"': return parse_text();
        case 't': return parse_word("true", Json::Kind::Number, 1.0);
        case 'f': return parse_word("false", Json::Kind::Number, 0.0);
        case 'n': return parse_word("null", Json::Kind::Null, 0.0);
        default: return parse_number();
        }
    }

    Json parse_nested(Json::Kind kind, char close) {
        Json value;
        value.kind = kind;
        at_++;
        if (++depth_ > most_depth) {
            expect("at most 32 brackets within each other");
        }
        if (!takes(close)) {
            do {
                if (kind == Json::Kind::Object) {
                    skip_space();
                    const std::string name = plain(parse_text().text);
                    take(':');
                    value.fields[name] = parse_value();
                } else {
                    value.items.push_back(parse_value());
                }
            } while (!error_.is_set() && takes(','));
            take(close);
        }
        depth_--;
        return value;
    }

    Json parse_text() {
        Json value;
        value.kind = Json::Kind::Text;
        take('"');
        while (at_ < text_.size() && text_[at_] != '"') {
            // What is escaped in names of abilities does not matter; that the text goes on after it does.
            at_ += text_[at_] == '\\' && at_ + 1 < text_.size() ? 1 : 0;
            value.text.push_back(text_[at_++]);
        }
        if (peek() == '"') {
            at_++;
        } else {
            expect("\"");
        }
        return value;
    }

    Json parse_number() {
        const std::size_t begin = at_;
        while (std::isdigit(static_cast<unsigned char>(peek())) || (peek() != '\0' && std::strchr("+-.eE", peek()) != nullptr)) {
            at_++;
        }
        const std::string digits = text_.substr(begin, at_ - begin);
        char* rest = nullptr;
        Json value;
        value.kind = Json::Kind::Number;
        value.number = std::strtod(digits.c_str(), &rest);
        if (digits.empty() || *rest != '\0') {
            at_ = begin;
            expect("a value");
        }
        return value;
    }

    Json parse_word(const char* word, Json::Kind kind, double number) {
        if (text_.compare(at_, std::strlen(word), word) != 0) {
            expect("a value");
            return {};
        }
        at_ += std::strlen(word);
        Json value;
        value.kind = kind;
        value.number = number;
        return value;
    }

    char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }

    void skip_space() {
        while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) {
            at_++;
        }
    }

    bool takes(char wanted) {
        skip_space();
        const bool is_there = peek() == wanted;
        at_ += is_there ? 1 : 0;
        return is_there;
    }

    void take(char wanted) {
        if (!takes(wanted)) {
            expect(std::string(1, wanted));
        }
    }

    // Notes the first fault, and goes to the end of the text, where parsing stops.
    void expect(const std::string& expected) {
        if (!error_.is_set()) {
            const auto line = 1 + std::count(text_.begin(), text_.begin() + std::ptrdiff_t(std::min(at_, text_.size())), '\n');
            error_ = {SF_BAD_FILE, "line " + std::to_string(line) + " is no JSON: " + expected + " was expected; export the file again"};
        }
        at_ = text_.size();
    }

    const std::string& text_;
    std::size_t at_ = 0;
    int depth_ = 0;
    Error error_;
};

// Reads values of JSON as what links have, and keeps the first fault.
class Reader {
public:
    Link read_link(const Json& json, const std::string& name) {
        Link link;
        const Json& nested = json.field("about");
        const Json& about = nested.kind == Json::Kind::Object ? nested : json;
        link.left = read_point(json.field("left"), name + ".Left");
        link.right = read_point(json.field("right"), name + ".Right");
        link.direction = read_direction(json.field("direction"), name + ".Direction");
        link.snap_radius = read_number(json.field("snapRadius"), link.snap_radius, name + ".SnapRadius");
        link.entering_cost = read_number(json.field("enteringCost"), 0.0, name + ".EnteringCost");
        link.ability = about.field("ability").kind == Json::Kind::Text ? about.field("ability").text : json.field("area").text;
        link.chance = read_number(about.field("chance"), link.chance, name + ".chance");
        link.seconds = read_number(about.field("seconds"), 0.0, name + ".seconds");
        for (const Json& leap : about.field("leaps").items) {
            link.leaps.push_back(read_leap(leap, name + ".leaps[" + std::to_string(link.leaps.size()) + "]", link.ability));
        }
        if (about.field("takeOff").kind != Json::Kind::Null) {
            link.leaps.push_back(read_leap(about, name, link.ability));
        }
        return link;
    }

    const Error& error() const { return error_; }

private:
    LinkLeap read_leap(const Json& json, const std::string& name, const std::string& ability) {
        const Json& own = json.field("ability");
        return {own.kind == Json::Kind::Text ? own.text : ability, read_point(json.field("takeOff"), name + ".take_off"),
                read_point(json.field("apex"), name + ".apex"), read_point(json.field("landing"), name + ".landing"),
                read_number(json.field("seconds"), 0.0, name + ".seconds")};
    }

    Vector read_point(const Json& json, const std::string& name) {
        if (json.items.size() == 3) {
            return {read_number(json.items[0], name), read_number(json.items[1], name), read_number(json.items[2], name)};
        }
        if (json.kind != Json::Kind::Object) {
            refuse(name + " is no point: it must be {\"X\": 0, \"Y\": 0, \"Z\": 0} or [0, 0, 0]");
            return {};
        }
        return {read_number(json.field("x"), name + ".X"), read_number(json.field("y"), name + ".Y"), read_number(json.field("z"), name + ".Z")};
    }

    double read_number(const Json& json, const std::string& name) {
        if (json.kind != Json::Kind::Number || !std::isfinite(json.number)) {
            refuse(name + " is no number");
        }
        return json.number;
    }

    double read_number(const Json& json, double missing, const std::string& name) {
        return json.kind == Json::Kind::Null ? missing : read_number(json, name);
    }

    LinkDirection read_direction(const Json& json, const std::string& name) {
        if (json.kind == Json::Kind::Null || plain(json.text) == "lefttoright") {
            return LinkDirection::LeftToRight;
        }
        if (plain(json.text) == "righttoleft") {
            return LinkDirection::RightToLeft;
        }
        if (plain(json.text) != "bothways") {
            refuse(name + " is '" + json.text + "': use LeftToRight, RightToLeft or BothWays");
        }
        return LinkDirection::BothWays;
    }

    void refuse(const std::string& text) {
        if (!error_.is_set()) {
            error_ = {SF_BAD_FILE, text};
        }
    }

    Error error_;
};

}  // namespace

Result<std::vector<Link>> parse_links(const std::string& text) {
    const Result<Json> document = Parser(text).parse();
    if (!document) {
        return document.error;
    }
    const Json& file = *document.value;
    const Json& version = file.field("version");
    if (version.kind == Json::Kind::Number && version.number > known_version) {
        return Error{SF_BAD_FILE, "the file has version " + std::to_string(int(version.number)) + ", but this plugin reads up to "
                                      + std::to_string(known_version) + ": take both from one release"};
    }
    const Json& list = file.kind == Json::Kind::List ? file : file.field("links");
    if (list.kind != Json::Kind::List) {
        return Error{SF_BAD_FILE, "the file has no list of links: write it with `surefoot graph export --format unreal`"};
    }
    Reader reader;
    std::vector<Link> links;
    for (const Json& item : list.items) {
        links.push_back(reader.read_link(item, "links[" + std::to_string(links.size()) + "]"));
    }
    if (reader.error().is_set()) {
        return reader.error();
    }
    return links;
}

}  // namespace surefoot
