// Plans in C++17: handles that destroy themselves, and errors as exceptions.
//
//     plans GRAPH      a file of `surefoot graph export --format json`
#include "surefoot.h"

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

namespace {

struct Destroy {
    void operator()(sf_graph* graph) const { sf_graph_destroy(graph); }
};
using Graph = std::unique_ptr<sf_graph, Destroy>;

// Makes a call, which gets an error last, and throws what it says.
template <typename Call, typename... Arguments>
void must(Call call, Arguments... arguments) {
    sf_error error;
    if (call(arguments..., &error) != SF_OK) {
        throw std::runtime_error(error.message);
    }
}

Graph load(const char* path) {
    sf_graph* graph = nullptr;
    must(sf_graph_load, path, &graph);
    return Graph(graph);
}

std::vector<sf_vec3> vertices(const Graph& graph) {
    size_t count = 0;
    // Too little room is an answer, too: it says how much there must be.
    if (sf_graph_vertices(graph.get(), nullptr, 0, &count, nullptr) != SF_BUFFER_TOO_SMALL) {
        throw std::runtime_error("a graph has vertices");
    }
    std::vector<sf_vec3> places(count);
    must(sf_graph_vertices, static_cast<const sf_graph*>(graph.get()), places.data(), places.size(), &count);
    return places;
}

sf_query query(sf_vec3 start, sf_vec3 goal) {
    sf_query query{};
    query.struct_size = sizeof query;
    query.start = start;
    query.goal = goal;
    query.caution = 1.0f;
    return query;
}

struct Found {
    sf_plan plan;
    std::vector<sf_leg> legs;
};

Found find(const Graph& graph, const sf_query& query) {
    Found found{{}, std::vector<sf_leg>(16)};
    size_t count = 0;
    const auto call = [&](sf_error* error) {
        return sf_graph_find_path(graph.get(), &query, found.legs.data(), found.legs.size(), &count, &found.plan, error);
    };
    if (call(nullptr) == SF_BUFFER_TOO_SMALL) {
        found.legs.resize(count);
    }
    must(call);
    found.legs.resize(count);
    return found;
}

// The first leg of a plan that runs along an edge; null if none does.
const sf_leg* edge_of(const Found& found) {
    for (const sf_leg& leg : found.legs) {
        if (leg.key.from != SF_STOP_START && leg.key.to != SF_STOP_GOAL) {
            return &leg;
        }
    }
    return nullptr;
}

bool uses(const Found& found, sf_leg_key key) {
    for (const sf_leg& leg : found.legs) {
        if (leg.key.from == key.from && leg.key.to == key.to) {
            return true;
        }
    }
    return false;
}

int run(const char* path) {
    const Graph graph = load(path);
    const std::vector<sf_vec3> places = vertices(graph);
    const sf_query wanted = query(places.front(), places[places.size() / 2]);
    const Found found = find(graph, wanted);
    std::printf("%zu legs, %.1f s, chance %.3f\n", found.legs.size(), double(found.plan.seconds), double(found.plan.arrival_chance));

    if (const sf_leg* leg = edge_of(found)) {
        // A door falls shut.
        must(sf_graph_set_edge_open, graph.get(), leg->key.from, leg->key.to, 0);
        if (uses(find(graph, wanted), leg->key)) {
            return 1;
        }
        must(sf_graph_set_edge_open, graph.get(), leg->key.from, leg->key.to, 1);
    }

    // Searches from many threads at once.
    std::vector<std::thread> threads;
    for (int idx = 0; idx < 4; idx++) {
        threads.emplace_back([&] {
            for (const sf_vec3& place : places) {
                find(graph, query(places.front(), place));
            }
        });
    }
    for (std::thread& thread : threads) {
        thread.join();
    }

    std::vector<sf_plan> plans(8);
    std::vector<sf_leg> legs(1024);
    size_t plan_count = 0, leg_count = 0;
    must(sf_graph_find_alternatives, static_cast<const sf_graph*>(graph.get()), &wanted, plans.data(), plans.size(), &plan_count,
         legs.data(), legs.size(), &leg_count);
    for (size_t idx = 0; idx < plan_count; idx++) {
        std::printf("alternative %zu: %u legs, %.1f s\n", idx, plans[idx].leg_count, double(plans[idx].seconds));
    }
    try {
        load("no such file");
    } catch (const std::runtime_error& error) {
        std::printf("an error: %s\n", error.what());
        return 0;
    }
    return 1;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: plans GRAPH\n");
        return 1;
    }
    try {
        return run(argv[1]);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
