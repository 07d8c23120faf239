local languages = { "idsl", "cdsl", "pdsl", "ddsl", "smdsl" }

for _, name in ipairs(languages) do
  vim.filetype.add({ extension = { [name] = name } })
end

vim.lsp.config("robocomp", {
  cmd = { "rc", "lsp" },
  filetypes = languages,
  root_markers = { ".git" },
  init_options = { include = { "interfaces" } },
})
vim.lsp.enable("robocomp")
