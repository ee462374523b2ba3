// Tests of the adapter, with the simulation of libsurefoot as the game.
//
//     adapter LEVEL GRAPH SQUARE SQUARE_GRAPH WALLED LINKS [EXPORTED]
//
// The script `check` makes level and graphs, and exports links of them if the program can; the other files lie beside this one.
#include "game.h"

#include "SurefootLinkFile.h"

#include <algorithm>
#include <atomic>
#include <fstream>
#include <new>
#include <random>
#include <sstream>

namespace {

std::atomic<std::size_t> allocation_count{0};

}  // namespace

// Every allocation of this program counts. Those of the library are its own, and not seen here.
void* operator new(std::size_t size) {
    allocation_count++;
    if (void* found = std::malloc(size)) {
        return found;
    }
    std::abort();
}

void operator delete(void* pointer) noexcept { std::free(pointer); }
void operator delete(void* pointer, std::size_t) noexcept { std::free(pointer); }

namespace {

using surefoot::Agents;
using surefoot::Attempt;
using surefoot::AttemptState;
using surefoot::Character;
using surefoot::Controls;
using surefoot::Graph;
using surefoot::LevelFrame;
using surefoot::Vector;

constexpr double metre = 100.0;

std::string text_of(const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(path, std::ios::binary).rdbuf();
    return text.str();
}

Agents agents_of(std::uint32_t count) { return must(Agents::create("general-reactive", must(surefoot::default_body()), count)); }

// ----------------------------------------------------------------------------------------------------------------- frames

void places_and_angles_come_back() {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> number(-1e5, 1e5);
    const LevelFrame frame(Vector{-2200.0, 700.0, -100.0});
    for (int idx = 0; idx < 1000; idx++) {
        const Vector place{number(random), number(random), number(random)};
        expect_near(frame.from_map(frame.to_map(place)), place, 0.05, "a place");
        expect_near(LevelFrame::from_map_velocity(LevelFrame::to_map_velocity(place)), place, 0.05, "a velocity");
        const double degrees = number(random) / 100.0;
        expect_near(LevelFrame::from_map_yaw(LevelFrame::to_map_yaw(degrees)), degrees, 1e-3, "an angle");
    }
}

// Corners of a turned block, by Unreal's rotation and by the map's.
void blocks_keep_their_corners() {
    const LevelFrame frame(Vector{-2200.0, 700.0, -100.0});
    const surefoot::Block block{{300.0, -200.0, 150.0}, {100.0, 40.0, 70.0}, 30.0};
    const sf_block native = frame.to_map_block(block);
    const double turn = 0.5235987755982988, cosine = std::cos(turn), sine = std::sin(turn);
    const float map_cosine = std::cos(native.yaw), map_sine = std::sin(native.yaw);
    for (const double side : {-1.0, 1.0}) {
        const double along = block.extent.x, across = side * block.extent.y;
        const Vector corner{block.centre.x + along * cosine - across * sine, block.centre.y + along * sine + across * cosine,
                            block.centre.z - block.extent.z};
        const float x = native.width / 2.0f, z = float(side) * native.depth / 2.0f;
        const sf_vec3 found{native.foot.x + x * map_cosine + z * map_sine, native.foot.y, native.foot.z - x * map_sine + z * map_cosine};
        expect_near(frame.from_map(found), corner, 0.05, "a corner of a block");
    }
    expect_near(native.height, 1.4, 1e-3, "the height of a block");
}

// An unrotated actor faces +x and has +y at its right; 90 degrees turn it to +y.
void sides_agree(const std::string& square) {
    struct Case {
        double yaw_degrees;
        Controls controls;
        Vector direction;
    };
    const Case cases[] = {
        {0.0, {1.0, 0.0, 0.0, false}, {1.0, 0.0, 0.0}},
        {0.0, {0.0, 1.0, 0.0, false}, {0.0, 1.0, 0.0}},
        {90.0, {1.0, 0.0, 0.0, false}, {0.0, 1.0, 0.0}},
        {90.0, {0.0, 1.0, 0.0, false}, {-1.0, 0.0, 0.0}},
    };
    const LevelFrame frame = must(LevelFrame::of_level(square));
    for (const Case& one : cases) {
        Game game(square, frame);
        const std::uint32_t npc = game.spawn({}, one.yaw_degrees);
        game.decide(npc, one.controls);
        for (int tick = 0; tick < 10; tick++) {
            game.tick();
        }
        Vector moved = game.character(npc).velocity;
        moved.z = 0.0;
        const double speed = surefoot::distance(moved, {});
        expect_near({moved.x / speed, moved.y / speed, 0.0}, one.direction, 0.01, "the direction of a move");
    }
    Game game(square, frame);
    const std::uint32_t npc = game.spawn({}, 0.0);
    game.decide(npc, {0.0, 0.0, 1.0, false});
    game.tick();
    expect_near(game.character(npc).yaw_degrees, 3.0, 0.1, "the rotation after a tick of a turn to the right");
}

// The square is 40 m wide around its origin, wherever that lies on the map.
void levels_keep_their_origin(const std::string& square) {
    const LevelFrame frame = must(LevelFrame::of_level(square));
    Game game(square, frame);
    const auto below = [&](double x, double y) {
        const surefoot::Segment segment{{x, y, 5.0 * metre}, {x, y, 5.0 * metre - SF_RAY_RANGE * metre}};
        surefoot::SegmentHit hit;
        game.trace(&segment, 1, &hit);
        return hit;
    };
    expect(below(19.0 * metre, -19.0 * metre).surface == SF_SURFACE_GROUND, "there is ground within the square");
    expect_near(below(0.0, 0.0).distance, 5.0 * metre, 0.5, "the height above the square");
    expect(below(21.0 * metre, 0.0).surface == SF_SURFACE_NONE, "there is none outside");
}

// ----------------------------------------------------------------------------------------------------------------- animation

// A run with a jump, in frames of another length than ticks.
void leaps_have_phases(const std::string& square) {
    const LevelFrame frame = must(LevelFrame::of_level(square));
    const sf_body body = must(surefoot::default_body());
    for (const int frames_per_tick : {1, 2}) {
        Game game(square, frame);
        const std::uint32_t npc = game.spawn({-15.0 * metre, 0.0, 0.0}, 0.0);
        surefoot::Locomotion moving;
        std::string phases, last;
        double widest = 0.0;
        for (int decision = 0; decision < 10; decision++) {
            const Controls controls{1.0, 0.0, 0.0, decision == 2};
            game.decide(npc, controls);
            for (std::uint32_t tick = 0; tick < SF_TICKS_PER_DECISION; tick++) {
                game.tick();
                for (int part = 0; part < frames_per_tick; part++) {
                    const sf_ability used = decision == 2 && tick == 0 && part == 0 ? SF_JUMP : SF_WALK;
                    const double seconds = 1.0 / SF_TICKS_PER_SECOND / frames_per_tick + 1e-9;
                    must(moving.advance(body, game.character(npc), controls, seconds, used));
                }
                const std::string now = std::to_string(moving.phase()) + "," + std::to_string(moving.ability()) + " ";
                phases += now == last ? "" : now;
                last = now;
                widest = std::max(widest, moving.stride());
            }
        }
        expect(phases == "0,0 1,1 2,1 0,0 ", "none, flight and landing by a jump, none: " + phases);
        expect(moving.pace() == SF_PACE_RUN, "the pace of a run");
        expect(widest > 4.0 * metre, "the stride at 11 m/s");
        expect(std::abs(moving.step_offset()) <= body.step_height * metre, "the offset over steps");
    }
}

// ----------------------------------------------------------------------------------------------------------------- agents

Vector goal_behind(const Vector& feet) { return {feet.x - 9.0 * metre, feet.y + 4.0 * metre, feet.z}; }

// A crowd on the square, each with a goal.
struct Crowd {
    explicit Crowd(const std::string& square, std::uint32_t count)
        : frame(must(LevelFrame::of_level(square))), game(square, frame), agents(agents_of(count)), controls(count) {
        agents.set_frame(frame);
        for (std::uint32_t id = 0; id < count; id++) {
            const Vector feet{(id % 8) * 2.0 * metre - 7.0 * metre, (id / 8) * 2.0 * metre - 7.0 * metre, 0.0};
            ids.push_back(id);
            npcs.push_back(game.spawn(feet, id * 20.0));
            characters.push_back(game.character(npcs.back()));
            must(agents.begin(id, id));
            attempts.push_back(must(Attempt::begin(agents, id, nullptr, feet, goal_behind(feet))));
        }
    }

    LevelFrame frame;
    Game game;
    Agents agents;
    std::vector<std::uint32_t> ids, npcs;
    std::vector<Character> characters;
    std::vector<Attempt> attempts;
    std::vector<Controls> controls;
};

void decides_for_many_without_allocation(const std::string& square) {
    Crowd crowd(square, 64);
    must(crowd.agents.decide(nullptr, nullptr, 0, crowd.game, nullptr));
    must(crowd.agents.decide(crowd.ids.data(), crowd.characters.data(), 64, crowd.game, crowd.controls.data()));
    const std::size_t before = allocation_count;
    for (int decision = 0; decision < 10; decision++) {
        must(crowd.agents.decide(crowd.ids.data(), crowd.characters.data(), 64, crowd.game, crowd.controls.data()));
        must(crowd.agents.has_arrived(crowd.characters[0], crowd.characters[0].feet, metre, crowd.game));
    }
    const std::size_t made = allocation_count - before;
    expect(made == 0, "decisions allocate nothing");
    for (const Controls& controls : crowd.controls) {
        const double most = std::max({std::abs(controls.forward), std::abs(controls.right), std::abs(controls.turn)});
        expect(most > 0.0 && most <= 1.0, "controls are shares");
    }
}

// Decides and moves until the attempt ends, with a goal that may move at each decision. Returns the number of decisions.
template <typename Goal>
int chase(Game& game, std::uint32_t npc, Agents& agents, Attempt& attempt, Goal goal) {
    const std::uint32_t id = 0;
    int decisions = 0;
    for (; decisions < 1500; decisions++) {
        const Character character = game.character(npc);
        must(attempt.advance(character, game));
        if (attempt.state() != AttemptState::GoesOn) {
            break;
        }
        must(attempt.move_goal(goal(decisions), character.feet));
        Controls controls;
        must(agents.decide(&id, &character, 1, game, &controls));
        game.decide(npc, controls);
        // An attempt may end at any tick; where the character goes afterwards is not part of it.
        for (std::uint32_t tick = 0; tick < SF_TICKS_PER_DECISION && attempt.state() == AttemptState::GoesOn; tick++) {
            game.tick();
            must(attempt.note(game.character(npc), game));
        }
    }
    return decisions;
}

int walk(Game& game, std::uint32_t npc, Agents& agents, Attempt& attempt) {
    const Vector goal = attempt.goal();
    return chase(game, npc, agents, attempt, [goal](int) { return goal; });
}

void walks_straight(const std::string& square) {
    const LevelFrame frame = must(LevelFrame::of_level(square));
    Game game(square, frame);
    Agents agents = agents_of(1);
    agents.set_frame(frame);
    must(agents.begin(0, 3));
    const std::uint32_t npc = game.spawn({}, 0.0);
    Attempt attempt = must(Attempt::begin(agents, 0, nullptr, {}, {-12.0 * metre, 9.0 * metre, 0.0}));
    walk(game, npc, agents, attempt);
    expect(attempt.state() == AttemptState::Reached, "the goal is reached without a plan");
}

// Rays that end on the same hit.
struct OneHit : surefoot::RayBatch {
    void trace(const surefoot::Segment* segments, std::size_t count, surefoot::SegmentHit* hits) override {
        expect(count == 2, "two rays lead to a goal");
        expect(segments[0].start.z < segments[1].start.z, "one ray is above the other");
        std::fill_n(hits, count, hit);
        trace_count++;
    }
    surefoot::SegmentHit hit{0.5 * metre, SF_SURFACE_GROUND};
    int trace_count = 0;
};

void arrives_standing(const std::string& square) {
    Agents agents = agents_of(1);
    agents.set_frame(must(LevelFrame::of_level(square)));
    must(agents.begin(0, 3));
    const Vector goal{5.0 * metre, 0.0, 0.0};
    Character standing;
    standing.feet = {5.8 * metre, 0.0, 0.0};
    standing.is_grounded = true;
    Character flying = standing, above = standing;
    flying.is_grounded = false;
    above.feet = {5.0 * metre, 0.0, 0.9 * metre};
    OneHit rays;
    Attempt attempt = must(Attempt::begin(agents, 0, nullptr, {}, goal));
    must(attempt.note(flying, rays));
    must(attempt.note(above, rays));
    expect(attempt.state() == AttemptState::GoesOn, "no one arrives in the air or on another floor");
    expect(rays.trace_count == 0, "no rays are traced before a character stands near its goal");
    must(attempt.note(standing, rays));
    expect(attempt.state() == AttemptState::GoesOn && rays.trace_count == 1, "no one arrives behind a wall");
    rays.hit = {};
    attempt.set_radius(0.5 * metre);
    must(attempt.note(standing, rays));
    expect(attempt.state() == AttemptState::GoesOn, "no one arrives outside the radius");
    attempt.set_radius(-1.0);
    expect_error(attempt.note(standing, rays), SF_INVALID_ARGUMENT, "radius");
    attempt.set_radius(0.85 * metre);
    must(attempt.note(standing, rays));
    expect(attempt.state() == AttemptState::Reached, "a character arrives where it stands in sight of its goal");
}

void chases_straight(const std::string& square) {
    const LevelFrame frame = must(LevelFrame::of_level(square));
    Game game(square, frame);
    Agents agents = agents_of(1);
    agents.set_frame(frame);
    must(agents.begin(0, 3));
    const std::uint32_t npc = game.spawn({}, 0.0);
    // 3 m/s, for 5 s.
    const auto target = [](int decision) { return Vector{(-9.0 + 0.5 * std::min(decision, 30)) * metre, 9.0 * metre, 0.0}; };
    Attempt attempt = must(Attempt::begin(agents, 0, nullptr, {}, target(0)));
    chase(game, npc, agents, attempt, target);
    expect(attempt.state() == AttemptState::Reached, "a goal that moves is reached without a plan");
    expect(!attempt.is_near_goal(attempt.goal(), attempt.goal()), "an attempt that has ended has no goal to be near to");
}

// ----------------------------------------------------------------------------------------------------------------- plans

// Walks to some goals, and returns how many were reached and how many decisions had a jump.
std::pair<int, int> visit(const std::string& level, const std::string& graph_path, int goal_count, const surefoot::Rehearsals* rehearsals) {
    // Any place does for a level that the simulation moves in; one off the origin shows what is not shifted.
    const LevelFrame frame(Vector{1234.0, -4321.0, 500.0});
    const Graph graph = must(Graph::load(graph_path));
    const std::vector<sf_vec3> places = must(graph.vertices());
    Game game(level, frame);
    int arrived = 0;
    for (int idx = 0; idx < goal_count; idx++) {
        Agents agents = agents_of(1);
        agents.set_frame(frame);
        must(agents.set_devices(game.devices()));
        must(agents.begin(0, std::uint64_t(idx)));
        const Vector start = frame.from_map(places[std::size_t(idx) * 7]);
        const Vector goal = frame.from_map(places[(std::size_t(idx) * 7 + places.size() / 2) % places.size()]);
        const std::uint32_t npc = game.spawn(start, 0.0);
        Attempt attempt = must(Attempt::begin(agents, 0, &graph, start, goal));
        attempt.set_rehearsals(rehearsals);
        const int decisions = walk(game, npc, agents, attempt);
        const Character character = game.character(npc);
        const bool is_there = attempt.state() == AttemptState::Reached;
        const bool is_near = surefoot::distance(character.feet, goal) <= SF_REACHED_WITHIN * metre + 1.0;
        const bool stands = is_near && character.is_grounded;
        expect(stands || !is_there, "a character that has arrived stands at its goal");
        std::printf("goal %d: %s after %.1f s\n", idx, is_there ? "arrived" : "did not arrive", decisions * Agents::decision_seconds);
        arrived += is_there;
    }
    return {arrived, game.jumps};
}

void walks_by_plan(const std::string& level, const std::string& graph_path) {
    constexpr int goal_count = 8;
    const std::pair<int, int> free = visit(level, graph_path, goal_count, nullptr);
    expect(free.first * 4 >= goal_count * 3, std::to_string(free.first) + " arrived");
    const std::string file = text_of(level);
    const surefoot::Rehearsals rehearsals =
        must(surefoot::Rehearsals::create("general-reactive", must(surefoot::default_body()), file.data(), file.size(), 0));
    const std::pair<int, int> calm = visit(level, graph_path, goal_count, &rehearsals);
    expect(calm.first == goal_count, std::to_string(calm.first) + " arrived with rehearsals");
    expect(3 * calm.second < 2 * free.second, std::to_string(calm.second) + " jumps with rehearsals, " + std::to_string(free.second) + " without");
}

// Crosses the square, where the game has a wall with a gap at its end. Returns the number of decisions.
int cross(const std::string& walled, const Graph& graph, const surefoot::Rehearsals& rehearsals, const LevelFrame& frame) {
    int decisions = 0;
    for (const double y : {-12.0, -6.0, 0.0, 6.0}) {
        Game game(walled, frame);
        Agents agents = agents_of(1);
        agents.set_frame(frame);
        must(agents.begin(0, 3));
        const Vector start{-15.0 * metre, y * metre, 0.0};
        const std::uint32_t npc = game.spawn(start, 0.0);
        Attempt attempt = must(Attempt::begin(agents, 0, &graph, start, {15.0 * metre, y * metre, 0.0}));
        attempt.set_rehearsals(&rehearsals);
        decisions += walk(game, npc, agents, attempt);
    }
    return decisions;
}

void walks_around_blocks(const std::string& square, const std::string& graph_path, const std::string& walled) {
    const LevelFrame frame = must(LevelFrame::of_level(square));
    expect_near(must(LevelFrame::of_level(walled)).map_corner(), frame.map_corner(), 0.0, "the corner of the walled level");
    const std::string file = text_of(square);
    const surefoot::Rehearsals rehearsals =
        must(surefoot::Rehearsals::create("general-reactive", must(surefoot::default_body()), file.data(), file.size(), 0));
    const int ignorant = cross(walled, must(Graph::load(graph_path)), rehearsals, frame);
    const surefoot::Block wall{{0.0, -6.0 * metre, 3.0 * metre}, {14.0 * metre, 0.5 * metre, 3.0 * metre}, 90.0};
    must(rehearsals.set_blocks({wall}, frame));
    const int aware = cross(walled, must(Graph::load(graph_path)), rehearsals, frame);
    std::printf("a wall: passed after %.1f s, and after %.1f s if it is known\n", ignorant * Agents::decision_seconds, aware * Agents::decision_seconds);
    expect(10 * aware < 9 * ignorant, "a wall that is known delays less");
    surefoot::Block flat = wall;
    flat.extent.z = 0.0;
    expect_error(rehearsals.set_blocks({wall, flat}, frame), SF_INVALID_ARGUMENT, "blocks[1]");
    must(rehearsals.set_blocks({}, frame));
    expect(cross(walled, must(Graph::load(graph_path)), rehearsals, frame) == ignorant, "a wall that is gone is forgotten");
}

void chases_by_plan(const std::string& level, const std::string& graph_path) {
    const LevelFrame frame;
    const Graph graph = must(Graph::load(graph_path));
    const std::vector<sf_vec3> places = must(graph.vertices());
    const Vector start = frame.from_map(places[0]), goal = frame.from_map(places[50]), far = frame.from_map(places[20]);
    Game game(level, frame);
    Agents agents = agents_of(1);
    must(agents.set_devices(game.devices()));
    must(agents.begin(0, 1));
    const std::uint32_t npc = game.spawn(start, 0.0);
    Attempt attempt = must(Attempt::begin(agents, 0, &graph, start, goal));
    must(attempt.advance(game.character(npc), game));
    const Vector first = attempt.waypoint();
    expect(attempt.is_near_goal({goal.x + 3.0 * metre, goal.y, goal.z}, start), "3 m are near");
    must(attempt.move_goal({goal.x + 0.2 * metre, goal.y, goal.z}, start));
    expect_near(attempt.waypoint(), first, 0.0, "the waypoint after a small move");
    expect(!attempt.is_near_goal(far, start), "the other goal is not near");
    must(attempt.move_goal(far, start));
    expect_error(attempt.move_goal({std::nan(""), 0.0, 0.0}, start), SF_INVALID_ARGUMENT, "goal");
    expect_near(attempt.goal(), far, 0.0, "the goal after an error");
    // The target walks up and down at 1.2 m/s.
    const auto target = [&far](int decision) { return Vector{far.x + std::abs(decision % 20 - 10) * 0.2 * metre, far.y, far.z}; };
    const int decisions = chase(game, npc, agents, attempt, target);
    expect(attempt.state() == AttemptState::Reached, "a target that moves is reached by plan");
    std::printf("a target that moves: arrived after %.1f s\n", decisions * Agents::decision_seconds);
}

void attempts_end(const std::string& level, const std::string& graph_path) {
    const LevelFrame frame;
    const Graph graph = must(Graph::load(graph_path));
    const Vector start = frame.from_map(must(graph.vertices()).front());
    Game game(level, frame);
    Agents agents = agents_of(1);
    const std::uint32_t npc = game.spawn(start, 0.0);

    Attempt in_air = must(Attempt::begin(agents, 0, &graph, start, {start.x, start.y, start.z + 25.0 * metre}));
    walk(game, npc, agents, in_air);
    expect(in_air.state() == AttemptState::Unreachable || in_air.state() == AttemptState::GaveUp, "a goal in the air is not reached");

    Attempt deadly = must(Attempt::begin(agents, 0, &graph, start, frame.from_map(must(graph.vertices())[50])));
    must(deadly.advance(game.character(npc), game));
    must(deadly.note_death());
    expect(deadly.state() == AttemptState::GaveUp, "a death ends an attempt");
}

// ----------------------------------------------------------------------------------------------------------------- errors

void errors_name_what_to_change(const std::string& square, const std::string& graph_path) {
    const sf_body body = must(surefoot::default_body());
    expect_error(Agents::create("general", body, 1), SF_NOT_FOUND, "use general-reactive or general-lstm");
    expect_error(Agents::create("no/such/folder", body, 1), SF_NOT_FOUND, "folder");
    expect_error(Agents::create("general-reactive", body, 0), SF_INVALID_ARGUMENT, "max_agents");
    expect_error(Graph::load("no such file"), SF_NOT_FOUND, "no such file");
    expect_error(Graph::load_memory("{", 1), SF_BAD_FILE, "");
    expect_error(LevelFrame::of_level(graph_path), SF_BAD_FILE, "");

    Crowd crowd(square, 2);
    expect_error(crowd.agents.decide(crowd.ids.data(), crowd.characters.data(), 3, crowd.game, crowd.controls.data()), SF_INVALID_ARGUMENT,
                 "raise max_agents");
    expect_error(crowd.agents.begin(2, 1), SF_INVALID_ARGUMENT, "agent");
    crowd.characters[0].velocity.z = std::nan("");
    expect_error(crowd.agents.decide(crowd.ids.data(), crowd.characters.data(), 2, crowd.game, crowd.controls.data()), SF_INVALID_ARGUMENT,
                 "velocity");
    expect_error(Attempt::begin(crowd.agents, 0, nullptr, {}, {0.0, std::nan(""), 0.0}), SF_INVALID_ARGUMENT, "goal");
    Graph graph = must(Graph::load(graph_path));
    expect_error(graph.set_edge_open(0, 0, false), SF_NOT_FOUND, "");
}

// ----------------------------------------------------------------------------------------------------------------- links

void links_are_read(const std::string& path) {
    const std::vector<surefoot::Link> links = must(surefoot::parse_links(text_of(path)));
    expect(links.size() == 2, "there are two links");
    expect_near(links[0].left, {3150.0, 5990.0, 1900.0}, 0.0, "Left");
    expect_near(links[0].right, {4920.0, 6350.0, 1020.0}, 0.0, "Right");
    expect(links[0].direction == surefoot::LinkDirection::LeftToRight, "the direction is read");
    expect(links[0].ability == "double-jump", "the ability is read");
    expect_near(links[0].snap_radius, 30.0, 0.0, "SnapRadius");
    expect_near(links[0].entering_cost, 3410.0, 0.0, "EnteringCost");
    expect_near(links[0].chance, 0.92, 0.0, "chance");
    expect(links[0].leaps.size() == 2 && links[1].leaps.empty(), "the leaps are read");
    expect_near(links[0].leaps[1].apex, {4400.0, 6200.0, 1400.0}, 0.0, "the apex of the second leap");
}

// Both ends of every link lie on the map.
void exported_links_are_read(const std::string& path) {
    const std::vector<surefoot::Link> links = must(surefoot::parse_links(text_of(path)));
    expect(!links.empty(), "there are links");
    for (const surefoot::Link& link : links) {
        for (const Vector& end : {link.left, link.right}) {
            const bool is_on_map = std::min(end.x, end.y) >= 0.0 && std::max(end.x, end.y) <= 100.0 * metre;
            expect(is_on_map, "the ends of " + link.ability + " lie on the map");
        }
    }
}

void links_are_read_tolerantly() {
    const auto links = must(surefoot::parse_links(
        "\xEF\xBB\xBF [{\"left\": [1, 2.5e0, -3], \"RIGHT\": {\"X\": 4, \"y\": 5, \"z\": 6}, \"later\": [null, true, {}], \"direction\": \"BothWays\","
        " \"ability\": \"ju\\\"mp\", \"takeOff\": [1, 2, 3], \"apex\": [2, 4, 3], \"landing\": [4, 5, 6]}]"));
    expect_near(links[0].left, {1.0, 2.5, -3.0}, 0.0, "a point as an array");
    expect(links[0].ability == "ju\"mp", "a text with an escaped character");
    expect(links[0].leaps.size() == 1, "a link with one leap");
    expect(must(surefoot::parse_links("{\"links\": []}")).empty(), "an empty file");
}

void links_that_are_wrong_are_refused_by_name() {
    const std::pair<std::string, std::string> cases[] = {
        {"{}", "has no list of links"},
        {"", "a value was expected"},
        {"{\"version\": 2, \"links\": []}", "has version 2"},
        {"{\n\"links\": [}", "line 2 is no JSON"},
        {"[] []", "end of the file"},
        {"[tru]", "a value"},
        {"[{\"left\": \"never ends", "\" was expected"},
        {std::string(100000, '['), "at most 32"},
        {"[{}]", "links[0].Left is no point"},
        {"[{\"left\": [0, 0, 0], \"right\": {\"x\": 0, \"y\": 1}}]", "links[0].Right.Z is no number"},
        {"[{\"left\": [0, 0, 0], \"right\": [0, 0, 0], \"direction\": \"Up\"}]", "use LeftToRight, RightToLeft or BothWays"},
    };
    for (const auto& [text, words] : cases) {
        expect_error(surefoot::parse_links(text), SF_BAD_FILE, words);
    }
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 7 && argc != 8) {
        std::fprintf(stderr, "usage: adapter LEVEL GRAPH SQUARE SQUARE_GRAPH WALLED LINKS [EXPORTED]\n");
        return 1;
    }
    const std::string level = argv[1], graph = argv[2], square = argv[3], square_graph = argv[4], walled = argv[5], links = argv[6];
    places_and_angles_come_back();
    blocks_keep_their_corners();
    sides_agree(square);
    levels_keep_their_origin(square);
    leaps_have_phases(square);
    decides_for_many_without_allocation(square);
    walks_straight(square);
    arrives_standing(square);
    chases_straight(square);
    walks_by_plan(level, graph);
    walks_around_blocks(square, square_graph, walled);
    chases_by_plan(level, graph);
    attempts_end(level, graph);
    errors_name_what_to_change(square, graph);
    links_are_read(links);
    if (argc == 8) {
        exported_links_are_read(argv[7]);
    }
    links_are_read_tolerantly();
    links_that_are_wrong_are_refused_by_name();
    std::printf("all passed\n");
    return 0;
}
