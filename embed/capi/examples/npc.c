/*
 * An NPC that walks to a goal by plan: the whole loop of a game, with our simulation as the game.
 *
 *     npc LEVEL GRAPH      the files of `surefoot map export` and `surefoot graph export --format json`
 *
 * A game replaces the functions of "the game" below by its own physics, and keeps the rest.
 */
#include "surefoot.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Ends the program with the text of an error. */
static void must(sf_status status, const sf_error* error) {
    if (status != SF_OK) {
        fprintf(stderr, "status %d: %s\n", (int)status, error->message);
        exit(1);
    }
}

/* ---------------------------------------------------------------------------------------------------------------- the game */

typedef struct game {
    sf_world* world;
    uint32_t npc;
} game;

/* What the character's rays hit: a game casts `rays` in its own physics. */
static void cast_rays(void* user, const sf_ray* rays, size_t ray_count, sf_hit* hits) {
    const game* self = (const game*)user;
    sf_error error;
    must(sf_world_cast_rays(self->world, rays, ray_count, hits, &error), &error);
}

static sf_state state_of(const game* self) {
    sf_state state;
    sf_error error;
    state.struct_size = sizeof(state);
    must(sf_world_state(self->world, self->npc, &state, &error), &error);
    return state;
}

static float distance(sf_vec3 a, sf_vec3 b) {
    const float x = a.x - b.x, y = a.y - b.y, z = a.z - b.z;
    return sqrtf(x * x + y * y + z * z);
}

/* ---------------------------------------------------------------------------------------------------------------- the NPC */

/* Whether the character stands at a goal, with nothing solid between. */
static int has_arrived(game* self, const sf_agents* agents, sf_vec3 goal) {
    const sf_state state = state_of(self);
    sf_error error;
    sf_ray rays[SF_ARRIVAL_RAY_COUNT];
    sf_hit hits[SF_ARRIVAL_RAY_COUNT];
    size_t ray_count;
    int32_t arrived = 0;
    const float radius = SF_REACHED_WITHIN;
    must(sf_agents_arrival_rays(agents, &state, goal, radius, rays, SF_ARRIVAL_RAY_COUNT, &ray_count, &error), &error);
    if (ray_count > 0) {
        cast_rays(self, rays, ray_count, hits);
        must(sf_agents_has_arrived(agents, &state, goal, radius, hits, &arrived, &error), &error);
    }
    return arrived;
}

/* Moves the character for a decision. Returns whether it came to its waypoint meanwhile: it passes most on the run or in
 * flight, but stands at the last one. */
static int move(game* self, const sf_agents* agents, sf_action action, const sf_step* step) {
    sf_error error;
    uint32_t tick;
    int reached = 0;
    must(sf_world_decide(self->world, self->npc, action, &error), &error);
    for (tick = 0; tick < SF_TICKS_PER_DECISION && !(step->stands && reached); tick++) {
        must(sf_world_tick(self->world, NULL, &error), &error);
        reached |= step->stands ? has_arrived(self, agents, step->waypoint)
                                : distance(state_of(self).feet, step->waypoint) <= SF_REACHED_WITHIN;
    }
    return reached;
}

/* What an NPC needs to find its way. */
typedef struct guide {
    sf_agents* agents;
    sf_graph* graph;
    sf_rehearsals* rehearsals;
} guide;

/* Does what the steps say until the next decision is prepared. Returns 0 if the attempt has failed. */
static int prepare(const guide* by, sf_follower* follower, const sf_state* state, sf_step* step) {
    const sf_vec3 origin = {0.0f, 0.0f, 0.0f}; /* Places of the simulation are on the map. */
    int is_prepared = 0;
    sf_error error;
    while (!is_prepared || step->kind != SF_STEP_KEEP) {
        if (step->kind == SF_STEP_GIVE_UP || step->kind == SF_STEP_UNREACHABLE) {
            return 0;
        }
        if (step->kind == SF_STEP_PLAN) {
            must(sf_follower_plan(follower, by->graph, state->feet, 1.0f, 0, step, &error), &error);
        }
        if (step->kind == SF_STEP_HEAD) {
            must(sf_agents_set_goal(by->agents, 0, state->feet, step->waypoint, &error), &error);
        }
        must(sf_follower_prepare(follower, by->rehearsals, by->agents, 0, state, origin, step, &error), &error);
        is_prepared = 1;
    }
    return 1;
}

/* Walks from one place to another by plan. Returns the number of decisions; 0 if it did not get there. */
static unsigned walk(game* self, const guide* by, sf_vec3 goal) {
    sf_follower* follower;
    sf_error error;
    sf_step step;
    sf_traversal traversals[64];
    size_t traversal_count;
    unsigned decisions = 0;
    int reached = 0;
    must(sf_follower_create(goal, &follower, &error), &error);
    step.struct_size = sizeof(step);
    for (;;) {
        const sf_state state = state_of(self);
        sf_action action;
        if (has_arrived(self, by->agents, goal)) {
            break;
        }
        must(sf_follower_advance(follower, state.feet, reached, &step, &error), &error);
        if (!prepare(by, follower, &state, &step) || decisions == 3000) {
            decisions = 0;
            break;
        }
        must(sf_agents_observe_with(by->agents, NULL, &state, 1, cast_rays, self, &error), &error);
        must(sf_agents_decide(by->agents, NULL, 1, SF_DEFAULT_NOISE, &action, &error), &error);
        reached = move(self, by->agents, action, &step);
        decisions++;
    }
    must(sf_follower_take_traversals(follower, traversals, 64, &traversal_count, &error), &error);
    must(sf_graph_note_traversals(by->graph, traversals, traversal_count, &error), &error);
    sf_follower_destroy(follower);
    return decisions;
}

/* Tells agents of the pads, zip lines and so on of the level. */
static void tell_devices(sf_agents* agents, const sf_map* map) {
    sf_error error;
    size_t count = 0;
    sf_device* devices;
    if (sf_map_devices(map, NULL, 0, &count, &error) == SF_OK) {
        return; /* There are none. */
    }
    devices = (sf_device*)malloc(count * sizeof(*devices));
    must(sf_map_devices(map, devices, count, &count, &error), &error);
    must(sf_agents_set_devices(agents, devices, count, &error), &error);
    free(devices);
}

/* Spawns a character at a vertex of the graph, and walks to others. Returns how many of `count` goals were reached. */
static unsigned visit(sf_world* world, const guide* by, unsigned count) {
    sf_error error;
    size_t vertex_count;
    unsigned idx, arrived = 0;
    sf_vec3* vertices;
    sf_graph_info info;
    info.struct_size = sizeof(info);
    must(sf_graph_describe(by->graph, &info, &error), &error);
    vertices = (sf_vec3*)malloc(info.vertex_count * sizeof(*vertices));
    must(sf_graph_vertices(by->graph, vertices, info.vertex_count, &vertex_count, &error), &error);
    for (idx = 0; idx < count; idx++) {
        const sf_vec3 start = vertices[idx * 7 % vertex_count], goal = vertices[(idx * 7 + vertex_count / 2) % vertex_count];
        game self;
        unsigned decisions;
        self.world = world;
        must(sf_world_spawn(world, start, 0.0f, &self.npc, &error), &error);
        must(sf_agents_begin(by->agents, 0, idx, &error), &error);
        decisions = walk(&self, by, goal);
        if (decisions > 0) {
            printf("goal %u: arrived after %.1f s\n", idx, decisions / 6.0);
        } else {
            printf("goal %u: did not arrive\n", idx);
        }
        arrived += decisions > 0;
        must(sf_world_despawn(world, self.npc, &error), &error);
    }
    free(vertices);
    return arrived;
}

/* What happens to calls that are wrong: a status, and what to change. */
static void show_errors(sf_agents* agents) {
    sf_error error;
    sf_action action;
    sf_graph* graph = NULL;
    if (sf_agents_decide(agents, NULL, 1, 2.0f, &action, &error) != SF_INVALID_ARGUMENT) {
        exit(1);
    }
    printf("\nThese calls are wrong on purpose, to show what they report:\n  wrong noise: %s\n", error.message);
    if (sf_graph_load("no such file", &graph, &error) != SF_NOT_FOUND || graph != NULL) {
        exit(1);
    }
    printf("  no file: %s\n", error.message);
    if (sf_graph_load_memory("{", 1, &graph, NULL) != SF_BAD_FILE) {
        exit(1);
    }
}

int main(int argc, char** argv) {
    const unsigned goal_count = 12;
    sf_error error;
    sf_policy* policy;
    guide by;
    sf_map* map;
    sf_world* world;
    unsigned arrived;
    if (argc != 3 || sf_abi_version() != SF_ABI_VERSION) {
        fprintf(stderr, "usage: npc LEVEL GRAPH\n");
        return 1;
    }
    printf("libsurefoot %s\n", sf_version());
    must(sf_policy_shipped(NULL, &policy, &error), &error);
    must(sf_agents_create(policy, NULL, 1, &by.agents, &error), &error);
    must(sf_map_load(argv[1], &map, &error), &error);
    tell_devices(by.agents, map);
    /* A game passes 1 instead of 0, so that rehearsals run on another thread. */
    must(sf_rehearsals_create(policy, map, NULL, 0, &by.rehearsals, &error), &error);
    sf_policy_destroy(policy);
    must(sf_world_create(map, NULL, &world, &error), &error);
    sf_map_destroy(map);
    must(sf_graph_load(argv[2], &by.graph, &error), &error);

    arrived = visit(world, &by, goal_count);
    printf("%u of %u arrived\n", arrived, goal_count);
    show_errors(by.agents);

    sf_rehearsals_destroy(by.rehearsals);
    sf_graph_destroy(by.graph);
    sf_world_destroy(world);
    sf_agents_destroy(by.agents);
    return arrived * 4 >= goal_count * 3 ? 0 : 1;
}
