# cmake -DINPUT=x.cl -DOUTPUT=x.cl.h -DNAME=x -P embed.cmake: a .cl file as a C++ raw string.
file(READ ${INPUT} text)
file(WRITE ${OUTPUT} "// Made from ${NAME}.cl by the build.\n#pragma once\n\nnamespace isoskin::source {\ninline constexpr char ${NAME}[] =\n")
# Compilers bound the length of one literal: cut into pieces of whole lines.
string(LENGTH "${text}" length)
set(at 0)
while(at LESS length)
  string(SUBSTRING "${text}" ${at} 8000 piece)
  file(APPEND ${OUTPUT} "R\"~cl~(${piece})~cl~\"\n")
  math(EXPR at "${at} + 8000")
endwhile()
file(APPEND ${OUTPUT} ";\n}  // namespace isoskin::source\n")
