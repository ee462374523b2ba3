"""Writes the pages of the reference that are generated, as Markdown.

    reference.py commands PROGRAM    every command of the program, from its help
    reference.py api FILE            every service and message, from a descriptor set with its comments (`buf build -o FILE.json`)
"""

import json
import re
import subprocess
import sys


def help_of(program, words):
    text = subprocess.run([program, *words, "--help"], capture_output=True, text=True, check=True).stdout
    return "\n".join(line.rstrip() for line in text.splitlines())


def commands_in(text):
    """Names of the subcommands that a help text lists."""
    block = re.search(r"^Commands:\n((?:  .*\n?)+)", text, re.M)
    names = re.findall(r"^  ([a-z][a-z-]*)", block.group(1), re.M) if block else []
    return [name for name in names if name != "help"]


def write_commands(program):
    print("# Commands\n\nGenerated from the help of the programs: `surefoot COMMAND --help` prints the same text.")

    def visit(words):
        text = help_of(program, words)
        print(f"\n## {' '.join(['surefoot', *words])}\n\n```text\n{text}\n```")
        for name in commands_in(text):
            visit([*words, name])

    visit([])


# Field numbers in descriptor.proto, as paths in source_code_info name them.
MESSAGES, ENUMS, SERVICES, FIELDS, NESTED, NESTED_ENUMS, VALUES, METHODS = 4, 5, 6, 2, 3, 4, 2, 2


def write_api(path):
    print("# gRPC API\n\nGenerated from the contracts in `proto/`. The same calls take and answer JSON: `POST /PACKAGE.SERVICE/METHOD`.")
    with open(path, encoding="utf-8") as text:
        files = [file for file in json.load(text)["file"] if file.get("package", "").startswith("surefoot.")]
    for file in files:
        comments = {
            tuple(location.get("path", [])): " ".join(location["leadingComments"].split())
            for location in file.get("sourceCodeInfo", {}).get("location", [])
            if "leadingComments" in location
        }
        print(f"\n## {file['name'].removeprefix('surefoot/')}")
        for idx, service in enumerate(file.get("service", [])):
            write_service(service, (SERVICES, idx), comments)
        for idx, message in enumerate(file.get("messageType", [])):
            write_message(message, (MESSAGES, idx), comments, "")
        for idx, enum in enumerate(file.get("enumType", [])):
            write_enum(enum, (ENUMS, idx), comments, "")


def write_service(service, at, comments):
    print(f"\n### {service['name']}\n\n{comments.get(at, '')}")
    for idx, method in enumerate(service.get("method", [])):
        takes = ("stream " if method.get("clientStreaming") else "") + short(method["inputType"])
        gives = ("stream " if method.get("serverStreaming") else "") + short(method["outputType"])
        print(f"\n**{method['name']}** (`{takes}`) returns `{gives}`\n\n{comments.get((*at, METHODS, idx), '')}")


def write_message(message, at, comments, outer):
    if message.get("options", {}).get("mapEntry"):
        return
    name = outer + message["name"]
    print(f"\n### {name}\n\n{comments.get(at, '')}")
    if message.get("field"):
        print("\n| field | type | |\n|---|---|---|")
    for idx, field in enumerate(message.get("field", [])):
        about = comments.get((*at, FIELDS, idx), "").replace("|", "\\|")
        print(f"| `{field['name']}` | {type_of(field)} | {about} |")
    for idx, inner in enumerate(message.get("nestedType", [])):
        write_message(inner, (*at, NESTED, idx), comments, f"{name}.")
    for idx, inner in enumerate(message.get("enumType", [])):
        write_enum(inner, (*at, NESTED_ENUMS, idx), comments, f"{name}.")


def write_enum(enum, at, comments, outer):
    print(f"\n### {outer}{enum['name']}\n\n{comments.get(at, '')}\n\n| value | |\n|---|---|")
    for idx, value in enumerate(enum.get("value", [])):
        print(f"| `{value['name']}` | {comments.get((*at, VALUES, idx), '')} |")


def type_of(field):
    name = short(field["typeName"]) if "typeName" in field else field["type"].removeprefix("TYPE_").lower()
    return f"repeated {name}" if field.get("label") == "LABEL_REPEATED" else name


def short(name):
    return name.rsplit(".", 1)[-1]


if __name__ == "__main__":
    {"commands": write_commands, "api": write_api}[sys.argv[1]](sys.argv[2])
