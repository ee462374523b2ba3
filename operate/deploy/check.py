"""Checks manifests, dashboard and alerts: SUREFOOT FOLDER-OF-RENDERED-LAYOUTS METRICS-URI..."""

import json
import pathlib
import re
import subprocess
import sys
import urllib.request

import jsonschema
import kubernetes_validate
import promql_parser
import yaml

DEPLOY = pathlib.Path(__file__).parent
# The oldest and the newest Kubernetes that manifests are checked for.
VERSIONS = ["1.30", "1.37"]
# Kinds of Agones and of KEDA, whose schemas are their own.
FOREIGN = ["Fleet", "FleetAutoscaler", "ScaledObject"]
FOREIGN = {kind: json.loads((DEPLOY / "schemas" / f"{kind.lower()}.json").read_text()) for kind in FOREIGN}
# What the Secret of a fleet holds, of the form that docs/guides/kubernetes.md says.
SECRETS = {"store": "postgres://surefoot:secret@postgres:5432/surefoot", "blobs": "s3://surefoot/blobs", "nats": "nats://nats:4222"}
# Prometheus makes these itself.
OWN_METRICS = {"up"}
errors = []


def closed(schema):
    """The schema without room for fields that it does not name: Kubernetes would drop them silently."""
    if isinstance(schema, list):
        return [closed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    schema = {key: closed(value) for key, value in schema.items()}
    if schema.get("type") == "object" and isinstance(schema.get("properties"), dict):
        schema.setdefault("additionalProperties", False)
    return schema


def check_schema(where, item):
    kind = item["kind"]
    if kind not in FOREIGN:
        for version in VERSIONS:
            try:
                kubernetes_validate.validate(item, version, strict=True)
            except (kubernetes_validate.ValidationError, kubernetes_validate.InvalidSchemaError) as error:
                errors.append(f"{where}: {kind} {item['metadata']['name']}, Kubernetes {version}: {getattr(error, 'message', error)}")
        return
    body = {"spec": item["spec"]}
    for error in jsonschema.Draft4Validator(closed(FOREIGN[kind])).iter_errors(body):
        errors.append(f"{where}: {kind} {item['metadata']['name']}: {'.'.join(map(str, error.path))}: {error.message}")
    if kind == "Fleet":
        # The pod in it, by Kubernetes' own schema.
        pod = item["spec"]["template"]["spec"]["template"]
        pod = {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": "pod", **pod["metadata"]}, "spec": pod["spec"]}
        check_schema(where, pod)


def pod_of(item):
    """The template of the pods that a resource makes."""
    if item["kind"] == "Fleet":
        return item["spec"]["template"]["spec"]["template"]
    return item["spec"].get("template") if item["kind"] in ("Deployment", "StatefulSet") else None


def flags_of(surefoot, command):
    """The variables that a command knows."""
    told = subprocess.run([surefoot, command, "--help"], capture_output=True, text=True, check=True).stdout
    return set(re.findall(r"\[env: ([A-Z_0-9]+)[=\]]", told))


def check_container(where, container, flags, surefoot):
    command = container["args"][0]
    known = flags.setdefault(command, flags_of(surefoot, command))
    variables = {}
    for variable in container["env"]:
        source = variable.get("valueFrom", {})
        if "secretKeyRef" in source:
            value = SECRETS[source["secretKeyRef"]["key"]]
        elif "fieldRef" in source:
            value = "pod-0"
        else:
            # Kubernetes fills in the variables before.
            value = re.sub(r"\$\((\w+)\)", lambda found: variables[found[1]], variable["value"])
        variables[variable["name"]] = value
    own = {variable["name"] for variable in container["env"] if "fieldRef" in variable.get("valueFrom", {})}
    for name in variables.keys() - known - own:
        errors.append(f"{where}: `surefoot {command}` knows no variable {name}")
    # Values: the program parses them. It reads no files yet.
    parsed = subprocess.run([surefoot, *container["args"], "--print-config"], env=variables, capture_output=True, text=True)
    if parsed.returncode != 0:
        errors.append(f"{where}: {parsed.stderr.strip()}")
    if "limits" not in container["resources"] or not {"cpu", "memory"} <= container["resources"]["requests"].keys():
        errors.append(f"{where}: requests and a limit of memory are missing")
    for mount in (value for value in variables.values() if value.startswith("/")):
        if not any(mount.startswith(volume["mountPath"]) for volume in container["volumeMounts"]):
            errors.append(f"{where}: {mount} lies on no volume")


def check_names(where, items, flags, surefoot):
    """What one resource says of another."""
    named = {(item["kind"], item["metadata"]["name"]) for item in items}
    pods = [pod_of(item) for item in items if pod_of(item)]

    def selects(labels, what):
        if not any(labels.items() <= pod["metadata"]["labels"].items() for pod in pods):
            errors.append(f"{where}: {what} selects no pod")

    for item in items:
        kind, name, spec = item["kind"], item["metadata"]["name"], item.get("spec", {})
        what = f"{kind} {name}"
        if kind == "Service":
            selects(spec["selector"], what)
        if kind in ("NetworkPolicy", "PodDisruptionBudget"):
            selects(spec.get("podSelector", spec.get("selector"))["matchLabels"], what)
        if kind in ("HorizontalPodAutoscaler", "ScaledObject") and (spec["scaleTargetRef"]["kind"], spec["scaleTargetRef"]["name"]) not in named:
            errors.append(f"{where}: {what} scales nothing")
        if kind == "FleetAutoscaler":
            if ("Fleet", spec["fleetName"]) not in named:
                errors.append(f"{where}: {what} scales nothing")
            fleet = next(other for other in items if other["kind"] == "Fleet")["spec"]["template"]["spec"]
            counter = fleet["counters"].get(spec["policy"]["counter"]["key"])
            if counter is None:
                errors.append(f"{where}: {what} scales by a counter that the fleet does not declare")
            server = next(it for it in fleet["template"]["spec"]["containers"] if it["name"] == fleet["container"])
            worlds = next(int(it["value"]) for it in server["env"] if it["name"] == "SUREFOOT_MAX_WORLDS")
            if fleet["counters"]["worlds"]["capacity"] != worlds:
                errors.append(f"{where}: the counter of worlds and SUREFOOT_MAX_WORLDS differ")
            if set(fleet["counters"]) != {"worlds", "npcs"}:
                errors.append(f"{where}: the server reports the counters worlds and npcs, the fleet declares {sorted(fleet['counters'])}")
        pod = pod_of(item)
        if not pod:
            continue
        if kind != "Fleet" and not item["spec"]["selector"]["matchLabels"].items() <= pod["metadata"]["labels"].items():
            errors.append(f"{where}: {what} does not select its own pods")
        volumes = {volume["name"] for volume in pod["spec"]["volumes"]}
        volumes |= {claim["metadata"]["name"] for claim in spec.get("volumeClaimTemplates", [])}
        for volume in pod["spec"]["volumes"]:
            claim = volume.get("persistentVolumeClaim")
            if claim and ("PersistentVolumeClaim", claim["claimName"]) not in named:
                errors.append(f"{where}: {what} claims {claim['claimName']}, which does not exist")
        for container in pod["spec"]["containers"]:
            check_container(f"{where}: {what}, container {container['name']}", container, flags, surefoot)
            for mount in container["volumeMounts"]:
                if mount["name"] not in volumes:
                    errors.append(f"{where}: {what} has no volume {mount['name']}")


def metrics_in(expression):
    """Names of the metrics in an expression, which must parse."""
    names = set()
    # Grafana fills this in.
    tree = promql_parser.parse(expression.replace("$__rate_interval", "5m").replace("$__range", "5m"))

    def visit(node):
        if isinstance(node, promql_parser.VectorSelector):
            names.add(node.name)
        if isinstance(node, promql_parser.MatrixSelector):
            names.add(node.vector_selector.name)
        for field in ("lhs", "rhs", "expr"):
            if isinstance(getattr(node, field, None), object) and getattr(node, field, None) is not None:
                visit(getattr(node, field))
        for argument in getattr(node, "args", None) or []:
            visit(argument)

    visit(tree)
    if not names:
        raise ValueError("no metric was found in it")
    return names


def expressions(value):
    """All values of `expr` in a document."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key == "expr":
                yield inner
            else:
                yield from expressions(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from expressions(inner)


def exported(uris):
    """Names of all samples that services export, from the types that they declare."""
    names = set()
    for uri in uris:
        text = urllib.request.urlopen(f"{uri}/metrics", timeout=10).read().decode()
        for name, kind in re.findall(r"^# TYPE (\S+) (\S+)$", text, re.M):
            names |= {f"{name}_bucket", f"{name}_sum", f"{name}_count"} if kind == "histogram" else {name}
    return names


def check_metrics(uris):
    known = exported(uris) | OWN_METRICS
    count = 0
    alerts = yaml.safe_load((DEPLOY / "monitoring" / "alerts.yml").read_text())
    for rule in (rule for group in alerts["groups"] for rule in group["rules"]):
        if not {"alert", "expr", "labels", "annotations"} <= rule.keys():
            errors.append(f"alerts.yml: {rule} is not an alert")
    for path, document in [
        ("alerts.yml", alerts),
        ("docs/grafana.json", json.loads((DEPLOY.parent.parent / "docs" / "grafana.json").read_text())),
    ]:
        for expression in expressions(document):
            count += 1
            try:
                for name in metrics_in(expression) - known:
                    errors.append(f"{path}: no service exports {name}")
            except ValueError as error:
                errors.append(f"{path}: `{expression}`: {error}")
    return count


def main():
    surefoot, rendered, *uris = sys.argv[1:]
    flags, count = {}, 0
    sources = [path for path in sorted(DEPLOY.glob("*/*.yaml")) if path.name != "kustomization.yaml"]
    for path in sources + sorted(pathlib.Path(rendered).glob("*.yaml")):
        items = [item for item in yaml.safe_load_all(path.read_text()) if item]
        count += len(items)
        for item in items:
            check_schema(path.name, item)
        if path not in sources:
            check_names(path.name, items, flags, surefoot)
    expression_count = check_metrics(uris)
    if errors:
        sys.exit("\n".join(errors))
    print(f"{count} manifests and {expression_count} expressions are good")


main()
