# Keeps the components of a bill of materials that are in `linked`, the lines of `cargo tree --format {p}`.
($linked | split("\n") | map(select(. != "") | split(" ") | {"\(.[0]) \(.[1] | ltrimstr("v"))": true}) | add) as $is_linked
| .components |= map(select($is_linked["\(.name) \(.version)"]))
| ([.metadata.component, .components[]] | map({(.["bom-ref"]): true}) | add) as $is_kept
| .dependencies |= map(select($is_kept[.ref]) | if .dependsOn then .dependsOn |= map(select($is_kept[.])) else . end)
